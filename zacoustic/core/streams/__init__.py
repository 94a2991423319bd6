"""What both ends agree on: streams, their keys, the table and its digest."""
