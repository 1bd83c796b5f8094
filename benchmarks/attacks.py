"""Cost of an attack: people, identities, memory and reports while an outsider attacks the system.

The system runs as `people4d up` starts it, without keys, with frames at 6 Hz of three people who
stand. An attacker who speaks plain Zenoh and MessagePack (tests/attacks) does one thing after the
other. Pause: the longest time without a message about all three, and the same before the attack
(calm). Lost: identities of the three that are others afterwards. Grown: memory of the process that
grew most. Reported: counter, reason in a heartbeat, and check of `people4d doctor` that must speak
of it, with the time from the beginning of the attack until the last of them did; negative: it still
stood there from the attack before.

Twenty thousand invented cameras are 60,000 messages as fast as they go, of which every reader
refuses all but the first before it decodes them; beside it as many in one name. Invented replicas
are 3,000, since Zenoh's own cost of tokens grows with their square: with a bare router and no
subscriber 3,000 take 0.4 s and 10,000 take 7.4 s.
"""

import argparse
import tempfile
import time
from pathlib import Path

from benchmarks.lib.table import markdown, write
from tests.attacks.attacker import ATTACKS
from tests.attacks.observer import ATTACK_S, Observer, attacking, begin_of
from tests.attacks.reports import REPORTS, Report
from tests.integration.system import running

STOPPED_S = 10.0  # for which a reader that stops is there
NAMES = {
    "invented_cameras_and_frames": 20_000,
    "as_many_messages_of_one_camera": 20_000,
    "invented_instances": 30_000,
    "invented_replicas": 3_000,  # of 10,000 tokens Zenoh takes 7 s, without a subscriber
}
HEADER = ("attack", "replaced", "calm [s]", "pause [s]", "lost", "grown [MB]", "reported", "[s]")


def main() -> None:
    """Attack a system and write the table."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("attacks", nargs="*", choices=[*ATTACKS, []], help="all if none")
    parser.add_argument("--names", type=int, help="names that are invented")
    options = parser.parse_args()
    rows, source = [], "tests.attacks.standing:StandingPeople"
    with (
        tempfile.TemporaryDirectory(prefix="p4d") as folder,
        running(Path(folder), source=source) as system,
    ):
        observer = Observer(system)
        try:
            for name in options.attacks or ATTACKS:
                rows.append(row(observer, name, options.names or NAMES.get(name, 0)))
                print(*rows[-1], sep=" | ", flush=True)
        finally:
            observer.close()
    if options.attacks:
        return
    reasons = [f"- {n}: {report.nothing}." for n, report in REPORTS.items() if report.nothing]
    write(
        __file__,
        "What an attack costs",
        (__doc__ or "").partition("\n\n")[2].strip(),
        "Numbers in brackets are how many names were invented, or how often one was used.",
        markdown(HEADER, rows),
        "Nothing is to be reported of:",
        "\n".join(reasons),
    )


def row(observer: Observer, name: str, names: int) -> list[str]:
    """Attack once and return the row of the table."""
    expected = REPORTS[name]
    before = observer.begin(expected)
    with attacking(observer, name, *([str(names)] if names else [])) as process:
        begun_s = begin_of(process)
        if name == "a_reader_that_stops":
            time.sleep(STOPPED_S)
        else:
            _, errors = process.communicate(timeout=ATTACK_S)
            if process.returncode:
                raise RuntimeError(errors.decode())
        observer.wait_for_report()
        observer.wait_for_people()
    after = observer.snapshot()
    grown = {n: after.memory_mb[n] - before.memory_mb.get(n, 0.0) for n in after.memory_mb}
    most = max(grown, key=lambda n: grown[n])
    late_s = max((at_s - begun_s for at_s in observer.reported_s.values()), default=0.0)
    return [
        f"{name} ({names})" if names else name,
        f"{sum(after.pids[n] != pid for n, pid in before.pids.items())}",
        f"{observer.calm_s:.2f}",
        f"{observer.longest_pause_s():.2f}",
        f"{len(before.positions_m.keys() - after.positions_m.keys())}",
        f"{grown[most]:.0f} ({most.partition('-')[0]})",
        described(expected),
        f"{late_s:.1f}" if expected.parts else "-",
    ]


def described(report: Report) -> str:
    """Return a report as text."""
    if report.nothing:
        return "nothing, see below"
    counter = f"`{report.counter}`" if report.counter else ""
    reason = f"“{report.reason}”" if report.reason else ""
    check = f"doctor: {report.check}" if report.check else ""
    return ", ".join(part for part in (counter, reason, check) if part)


if __name__ == "__main__":
    main()
