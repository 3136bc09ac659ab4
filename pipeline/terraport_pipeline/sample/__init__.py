"""A bounded look at the points of a survey, for ``inspect``; what it says of all of them."""
