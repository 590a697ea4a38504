"""`gsfw edit`: edits of splats and models, step by step."""
