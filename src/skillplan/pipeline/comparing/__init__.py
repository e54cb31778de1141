"""Several solvers on one problem, in turn or side by side, and their claims held together."""
