"""The files of a survey: found, told apart, and refused where they are no one survey."""
