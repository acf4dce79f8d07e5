"""Notes that layouts print under their tables."""

from __future__ import annotations

SHARE = (
    "SSC stands twice. With all coefficients kept (share 1) it is the setting that reproduces the published "
    "failures; with the share of .7 that SSC's own authors use for motion segmentation it is the fairer rival."
)

DIMENSION = (
    "EDSC stands twice, too: with subspaces of 4 dimensions, its authors' setting for rigid motion, and with 15 and a "
    "lighter data term (lambda 10 in place of 120) for bodies that deform."
)

CUT = (
    "BMM's authors cut the structure to rank K in the end. The paper names a K for UMPM alone, 11, which the column "
    "K = 11 takes for the pairs."
)

FIXED = (
    "Dance, face, walking and shark were recorded by a fixed camera and turn by themselves. No method can tell the "
    "body's turning from the camera's, so their published e_3D is taken in the camera frame, and e_R says nothing; "
    "with the fixed camera given, depth is not determined."
)

ADAPTIVE = (
    "Ours is the paper's method as printed: S = S C binds whole trajectories, with constant weights. Adaptive is this "
    "project's method, for which nothing is published: the code reads whitened motion, with slack in place of "
    "S = S C and weights that follow the noise that the tracks show."
)

ROOM = (
    "People stand where they were captured, and one orthographic camera circles them at 5 degrees a frame. Takes are "
    "thinned to at most 400 frames. The paper does not say which frames and camera it used on UMPM."
)

HIDDEN = (
    "e_3D counts all points, hidden ones too; e_3D of hidden points those alone whose observation was dropped. BMM and "
    "adaptive leave hidden points out of the data term, SSC and EDSC get tracks completed by the least nuclear norm. "
    "Observations are dropped one by one (random), or for 20 frames at a time (stretches)."
)

EIGENGAPS = (
    "No method is told how many bodies there are: each takes the number, of 1 to 10, at the widest gap between the "
    "eigenvalues of its affinity's normalised Laplacian. Tracks of clusters without a body count as wrong."
)

DENSE = (
    "The sequences are given out by their authors on request, and no generated data takes the place of an absent one. "
    "The cameras are those that see the true structure as the tracks do."
)

FURTHER = (
    "† Methods that the paper's table does not hold: SSC by orthogonal matching pursuit (SSC-OMP), the low-rank "
    "representation (LRR), and the point trajectory approach (PTA). One setting for all rows, chosen on these eight "
    "pairs before known cameras and without noise: 20 tracks of SSC-OMP, lambda = .5 of LRR, K = 9 of PTA."
)

TRAJECTORIES = (
    "PTA's published numbers are those of the reconstructions that its authors store with the sequences, with the K "
    "that is stored there and rotations of their own; here the rotations are BMM's, of the same K. Dance is stored as "
    "the fixed camera sees it, so its published number belongs beside e_3D in the camera frame. K of face, walking and "
    "shark is recalled from BMM's paper and not checked against it."
)
