"""Fully fused MLPs: a whole small network in one kernel (Mueller et al. 2021), or tiny-cuda-nn."""
