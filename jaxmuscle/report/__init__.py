"""Report of a diagnosis: a sentence (`sentence`), a page (`page`), files (`report_files`)."""
