"""Block 1: from a clip of one camera to a `Sequence`, and the studio that makes exact truth.

Nothing is imported here: reading a sequence must not load the estimator, nor the studio's kernels.
`capture.pipeline` captures, `capture.store` reads and writes, `capture.keypoints` reads a motion,
`capture.readers` opens public data sets, `capture.studio` films synthetic performers,
`capture.errors` draws the tree of what can go wrong.
"""
