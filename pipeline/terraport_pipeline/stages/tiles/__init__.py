"""Stages that work on tiles of a survey."""
