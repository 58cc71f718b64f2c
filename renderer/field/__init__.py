"""The paper's field: a canonical radiance field, moved by inverse skinning, drawn by ray marching.

Four networks (`networks.py`) after HumanNeRF (Weng et al. 2022), sized by one row of `sizes.py`.
"""
