"""Block 1: from a clip of one camera to a `Sequence`, and the studio that makes exact truth.

By stages, as data flows, each floor importing only those above it:

    errors
    body/           the body model, its landmarks and kinematics
    detection/      who is in the picture, and where their landmarks are
    segmentation/   which pixels are theirs
    sources/        clips, pictures, motions and public data sets that come in
    fitting/        body, camera and motion that explain a whole clip
    live/           the same, a frame at a time
    quality, storage, overlay, pipeline

`capture.studio` records synthetic performers with exact truth. Nothing is imported here: reading a
sequence must load neither the estimator nor the studio's kernels.
"""

import scene  # noqa: F401 - says how threads wait, before numpy is first imported
