"""Results as data with their JSON and the files they are kept in; never a table or a picture."""
