"""What commands do with folders of training runs."""
