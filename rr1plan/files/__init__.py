"""Reading files within bounds, writing them in one step: text, tables, XML, arrays, and the disk cache."""
