"""From what blocks what to an order: precedence, sub-assemblies, paths out, sequence, replay."""
