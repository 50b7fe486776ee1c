"""What every study is made of: cells, rows kept on disk, verdicts, statements."""
