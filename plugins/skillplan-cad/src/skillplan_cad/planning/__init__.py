"""Plan the assembly: precedence, sub-assemblies, removal paths, order, replay."""
