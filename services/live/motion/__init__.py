"""How performers move by the keypoints of their webcams."""
