"""Structure of an arm's geometry: axes that intersect or are parallel, and the closed forms that follow."""
