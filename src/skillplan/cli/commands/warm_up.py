"""``skillplan warm-up``."""

from __future__ import annotations


def command() -> int:
    """Compile ahead what searches and learners would compile at their first use.

    What is compiled is kept on this machine, so that it is done once. It takes about a minute.
    """
    import time

    from skillplan.cli.writing import tell, write_out
    from skillplan.pipeline.warm_up import warm_up_steps
    from skillplan.solvers.compilation import on_compilation

    kernels: list[str] = []
    steps = list(warm_up_steps())
    begin_s = time.perf_counter()
    done = on_compilation(kernels.append)
    try:
        for number, (what, compile_it) in enumerate(steps, 1):
            tell(f"compiling {number} of {len(steps)}: {what}")
            compile_it()
    finally:
        done()
    wall_s = time.perf_counter() - begin_s
    if kernels:
        write_out(f"{len(kernels)} kernels compiled in {wall_s:.1f} s; they are kept\n")
    else:
        write_out("nothing to compile: all kernels are kept already\n")
    return 0
