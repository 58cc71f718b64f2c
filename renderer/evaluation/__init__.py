"""How good a model is: pictures against the truth of unseen views."""
