"""What is declared once: units, tables of columns, parameters of files, parts by name, errors."""
