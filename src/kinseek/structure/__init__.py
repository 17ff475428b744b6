"""What the geometry of an arm gives: axes that meet or run parallel, and the closed forms that come of it."""
