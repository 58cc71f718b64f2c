"""Offers of WebRTC connections over HTTP: WHEP, WHIP, and the voices of pages."""
