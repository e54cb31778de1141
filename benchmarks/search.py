"""What exact search does against brute force: nodes, checks and seconds of the same run."""

from __future__ import annotations

from skillplan import Setup, Stop, load_problem, solve


def main() -> None:
    """Print the board's ratios, then exact search on every board and detector."""
    task = load_problem("configs/inverter_board.yaml").task
    brute, exact = solve(task, "exhaustive"), solve(task, "exact")
    assert brute.expanded is not None
    assert exact.expanded is not None
    print("inverter board                 exhaustive      exact    ratio")
    for name, one, other in (
        ("nodes", brute.expanded, exact.expanded),
        ("checks", brute.checks, exact.checks),
        ("milliseconds", 1000 * brute.wall_s, 1000 * exact.wall_s),
    ):
        print(f"{name:28} {one:12,.0f} {other:10,.0f} {one / other:8,.1f}")
    print()
    print(f"{'exact search':24} {'collision':12} {'status':9} {'cost':>9} {'nodes':>8} {'s':>7}")
    for config in ("inverter_board", "motor_drive"):
        task = load_problem(f"configs/{config}.yaml").task
        for detector in ("precedence", "aabb"):
            setup = Setup(collision=(detector,), with_chart=False)
            result = solve(task, "exact", setup, stop=Stop(time_limit_s=60))
            cost = "-" if result.cost is None else f"{result.cost:.5f}"
            print(
                f"{config:24} {detector:12} {result.status.value:9} {cost:>9} "
                f"{result.expanded or 0:8,} {result.wall_s:7.3f}"
            )


if __name__ == "__main__":
    main()
