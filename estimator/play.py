# cython: language_level=3, infer_types=True, annotation_typing=False
# cython: boundscheck=False, wraparound=False, cdivision=True, initializedcheck=False
"""Distance that each link may fall in its gap while its motor stands."""

from common.arrays import Matrix, Vector


def put_play(half_gap: Vector, phi: Vector, sigma: Vector, way: Matrix) -> None:
    """Write `Transmission.play` to way (2, n) [rad]."""
    for i in range(half_gap.shape[0]):
        most = 2.0 * half_gap[i]
        about = half_gap[i] + sigma[i]
        way[0, i] = min(max(phi[i] + about, 0.0), most)
        way[1, i] = min(max(about - phi[i], 0.0), most)
