"""Regions whose borders follow what is seen on the ground; arrays in, arrays out."""
