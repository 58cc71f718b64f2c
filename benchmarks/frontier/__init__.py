"""Speed against accuracy of every preset: measured, charted and set as a page."""
