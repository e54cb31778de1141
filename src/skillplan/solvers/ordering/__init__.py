"""The sequential ordering problem (SOP), compiled: jobs into an order at the least cost."""
