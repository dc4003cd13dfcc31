"""What a user gets of a diagnosis: a sentence (`sentence`), a page (`page`), files (`write`)."""
