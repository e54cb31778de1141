"""Convex pieces of meshes by CoACD (Wei, Liu, Ling and Su 2022), which is under the MIT licence."""

from __future__ import annotations

from importlib.metadata import version
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

# How far a piece may differ from what it stands for, of half the mesh's greatest extent.
_CONCAVITY: Final = 0.02
_ITERATIONS: Final = 100


class CoacdPieces:
    """Takes a closed mesh apart, the same way whenever it is asked."""

    @property
    def version(self) -> str:
        """Changes whenever pieces may."""
        return f"coacd {version('coacd')} concavity {_CONCAVITY} iterations {_ITERATIONS}"

    def __call__(
        self, corners: NDArray[np.float64], faces: NDArray[np.int64]
    ) -> list[tuple[Any, Any]]:
        """Return corners [m] and triangles of every piece.

        Parameters
        ----------
        corners
            Of the mesh [m], shape (corners, 3).
        faces
            Its triangles, anticlockwise from outside, shape (faces, 3).
        """
        # Only what is not kept yet pays for importing this.
        import coacd

        coacd.set_log_level("error")
        found = coacd.run_coacd(
            coacd.Mesh(corners, faces),
            threshold=_CONCAVITY,
            preprocess_mode="off",
            mcts_iterations=_ITERATIONS,
            seed=0,
        )
        return [(corners, faces) for corners, faces in found]


convex_pieces = CoacdPieces()
