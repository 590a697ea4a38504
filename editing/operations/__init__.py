"""Operations of the command line, each an edit with a value in text."""
