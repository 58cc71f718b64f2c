"""How somebody looks now: their model's splats take the colours that their webcam sees."""
