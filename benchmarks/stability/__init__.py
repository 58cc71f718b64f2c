"""Where methods fail: one thing of capture, training or a meeting is disturbed at a time."""
