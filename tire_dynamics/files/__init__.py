"""Files read strictly and written aside, progress, and the errors that name a file."""
