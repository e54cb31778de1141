"""Convex decomposition of meshes by CoACD (Wei, Liu, Ling and Su 2022; MIT licence)."""

from __future__ import annotations

from importlib.metadata import version
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

# Concavity threshold, relative to half the mesh's greatest extent.
_CONCAVITY: Final = 0.02
_ITERATIONS: Final = 100


class CoacdPieces:
    """Decomposes a closed mesh, deterministically."""

    @property
    def version(self) -> str:
        """Text that changes whenever pieces may change."""
        return f"coacd {version('coacd')} concavity {_CONCAVITY} iterations {_ITERATIONS}"

    def __call__(
        self, corners: NDArray[np.float64], faces: NDArray[np.int64]
    ) -> list[tuple[Any, Any]]:
        """Return corners [m] and triangles of every piece.

        Parameters
        ----------
        corners
            Corners of the mesh [m], shape (corners, 3).
        faces
            Triangles of the mesh, anticlockwise from outside, shape (faces, 3).
        """
        # Imported only for meshes that are not cached.
        import coacd

        coacd.set_log_level("error")
        pieces = coacd.run_coacd(
            coacd.Mesh(corners, faces),
            threshold=_CONCAVITY,
            preprocess_mode="off",
            mcts_iterations=_ITERATIONS,
            seed=0,
        )
        return [(corners, faces) for corners, faces in pieces]


convex_pieces = CoacdPieces()
