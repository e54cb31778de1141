"""Where bases stand and how they walk; never how a leg reaches up."""
