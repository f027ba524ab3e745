"""`stop` and `torque`: stop servos, and switch their torque."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import nullcontext

import click

from servobus import Bus, BusServo, ServobusError
from servobus.cli.finding import TRIES, Where, find_all, open_port, rounds_text
from servobus.cli.interrupts import signals_as_interrupt
from servobus.cli.options import as_json, check_to_limit, on_servos, to_limit_options, verb
from servobus.cli.output import json_entries, note, print_json, quantity_entry, warn_alarms, which
from servobus.cli.values import ALL, Ids, are_several
from servobus.core.ids import BROADCAST, LAST_ID
from servobus.errors import BusError, MotionError, NoReply, PortError, PortLost, StopFailed
from servobus.families import registry
from servobus.families.base import Family, StopOutcome
from servobus.jobs.everyone_off import LONGEST_FLUSH, by_speed, everyone_off, spare_bauds
from servobus.jobs.scan import FoundServo, ScanProgress, scan

Rounds = Sequence[tuple[Family, Sequence[int]]]
"""Families, each with speeds."""


@verb(
    "stop",
    "servobus stop /dev/ttyUSB0 1-4,7",
    "servobus stop /dev/ttyUSB0 all --family lewansoul",
    "servobus torque /dev/ttyUSB0 all off    # quickest: everybody is told at once",
)
@on_servos
def stop(port: str, ids: Ids, where: Where) -> None:
    """Stop servos on PORT where they are, each as soon as it is found.

    A servo is held where it is. Its torque is switched off if it stands outside its limits, or cannot be held for
    another reason; what was done is printed. An id that does not answer at the factory speeds is looked for at all
    others, and at last its torque is switched off without an answer. What may still move is told at the end.

    `all` asks every id, at the factory speeds, which takes up to half a minute; `servobus torque PORT all off` takes
    the power at once, at every speed.
    """

    def stop_one(servo: BusServo) -> None:
        click.echo(f"{servo.target} stopped: {servo.stop()}")

    with open_port(port) as bus:
        _each_as_it_is_found(bus, where, ids, stop_one)


@verb(
    "torque",
    "servobus torque /dev/ttyUSB0 1-4,7 on",
    "servobus torque /dev/ttyUSB0 1 on --to-limit --speed 10",
    "servobus torque /dev/ttyUSB0 all off",
)
@on_servos
@click.argument("state", metavar="on|off", type=click.Choice(["on", "off"]))
@to_limit_options
@as_json
def torque(port: str, ids: Ids, where: Where, state: str, to_limit: bool, speed: float | None, json: bool) -> None:
    """Switch the torque of servos on PORT on or off.

    On: each holds where it is, nothing moves, and none is switched on unless all are found. A servo that would run to
    its limits, because it stands outside of them, is refused; --to-limit brings it there slowly. Off: each shaft turns
    freely, so support what it carries; each is switched off as soon as it is found, as `stop` does.

    `all off` looks for nobody: every id is told, within two seconds twice at each speed that is usual for its family,
    then once at all others that it can be set to; or at --baud alone. No servo answers that.

    --json gives a list if several servos are named, or `all`; for `all off` which speeds were told.
    """
    if to_limit and state == "off":
        raise click.UsageError("--to-limit goes with on")
    check_to_limit(to_limit, speed)

    def switched(servo: BusServo) -> None:
        here = servo.look() if to_limit else None
        if entries is not None:
            position = {} if here is None else {"position": quantity_entry(here.position, "rad")}
            entry = {"torque": state == "on", **position}
            entries.append({**which(servo), **entry} if several else entry)
        else:
            click.echo(f"{servo.target}: torque {state}{'' if here is None else f', holds {here.place}'}")
        warn_alarms(servo)

    def switch_off(servo: BusServo) -> None:
        servo.torque_off()
        switched(servo)

    several = are_several(ids)
    with open_port(port) as bus, signals_as_interrupt():
        if state == "off" and ids == ALL:
            _all_off(bus, where, json=json)
            return
        with json_entries(several=several) if json else nullcontext() as entries:
            if state == "on":
                _torque_on(find_all(bus, where, ids), switched, to_limit=to_limit, speed=speed)
            else:
                _each_as_it_is_found(bus, where, ids, switch_off)


def _all_off(bus: Bus, where: Where, *, json: bool) -> None:
    """Tell every id at every speed to switch its torque off."""
    rounds = where.everywhere()
    odd = _odd(where, rounds) if where.baud is None else []
    _tell_torque_off(bus, where, rounds)
    if not json:
        click.echo("torque off: told all ids")
        for family, bauds in rounds:
            click.echo(click.wrap_text(f"{family.name} at {', '.join(map(str, bauds))}", 80, "  ", "    "))
    if odd:
        _tell_torque_off(bus, where, odd, times=1)
    if json:
        more = {family.name: bauds for family, bauds in odd}
        told = [{"family": one.name, "bauds": [*bauds, *more.get(one.name, ())]} for one, bauds in rounds]
        print_json({"torque": False, "told": told})
    elif odd:
        click.echo(f"and at {sum(len(bauds) for _, bauds in odd)} speeds in between, which are not usual")
    note("no servo answers that; `servobus scan` shows which obeyed")


def _torque_on(
    servos: Sequence[BusServo], then: Callable[[BusServo], None], *, to_limit: bool, speed: float | None
) -> None:
    """Switch each on, even if another fails; what failed is told at the end."""
    failed: list[str] = []
    for servo in servos:
        try:
            servo.torque_on(to_limit=to_limit, speed=speed)
            then(servo)
        except (BusError, MotionError) as error:
            failed.append(str(error))
            warn_alarms(servo)
    if failed:
        raise ServobusError("; ".join(failed))


def stop_all(bus: Bus, servos: Iterable[BusServo]) -> None:
    """Stop all of them, whatever else goes wrong, and tell of each."""
    note("")  # the terminal shows ^C: what comes next starts on a line of its own
    failed = ""
    outcomes: Mapping[BusServo, StopOutcome] = {}
    try:
        outcomes = bus.stop(servos)
    except StopFailed as error:
        outcomes, failed = error.stopped, str(error)
    except ServobusError as error:
        failed = f"servos may still move: {error}"
    for servo, outcome in outcomes.items():
        note(f"{servo.target} stopped: {outcome}")
    if failed:
        note(f"servobus: {failed}")


def _each_as_it_is_found(bus: Bus, where: Where, ids: Ids, action: Callable[[BusServo], None]) -> None:
    """Do something with each servo as soon as it is found, all that share an id among them.

    Raises ServobusError at the end that names those with which it failed, and the ids that nobody answers to.
    """
    failed: list[str] = []
    met: set[int] = set()

    def found_one(progress: ScanProgress) -> None:
        found = progress.found
        if found is None:
            return
        met.add(found.id)
        # Nothing is on the line while a watcher is called, so it may use the bus.
        try:
            servo = _known(bus, found)
            if found.model is None:
                servo.torque_off()
                click.echo(f"{found.family.title} id {found.id}, of an unknown model: let go, its torque is off")
            else:
                action(servo)
        except ServobusError as error:
            failed.append(f"{found.family.title} id {found.id} may still move: {error}")

    def look(rounds: Rounds, ids: Iterable[int]) -> None:
        asked = list(ids)
        for family, bauds in rounds if asked else ():
            bus.do(scan([family], bauds, asked, found_one, identify=bus.identify))

    bus.models = where.model
    rounds = list(where.rounds())
    if ids == ALL:
        look(rounds, range(LAST_ID + 1))
        if not met:
            failed.append(f"{bus.transport.name}: no servo answers ({where}); `servobus torque PORT all off` asks none")
    else:
        for _ in range(TRIES):
            look(rounds, [id for id in ids if id not in met])
        tried = rounds
        if where.baud is None and (missing := [id for id in ids if id not in met]):
            names = ", ".join(family.name for family, _ in rounds)
            note(f"looking for {_ids(missing)} at every speed of {names}, which takes some seconds")
            tried = where.everywhere()
            look(tried, missing)
        for id in [id for id in ids if id not in met]:
            _tell_torque_off(bus, where, tried, id)
            failed.append(
                f"{bus.transport.name}: no servo answers to id {id} (tried {rounds_text(tried)}), so it may still "
                "move; it was told to switch its torque off all the same"
            )
    if failed:
        raise NoReply("; ".join(failed))


def _known(bus: Bus, found: FoundServo) -> BusServo:
    model = registry.first_model(found.family) if found.model is None else found.model
    return bus.attach(model, found.id, baud=found.baud, answers=found.identity.answers)


def _tell_torque_off(bus: Bus, where: Where, rounds: Rounds, id: int = BROADCAST, *, times: int = 2) -> None:
    models = {family.name: list(where.models_of(family)) for family, _ in rounds}
    plan = by_speed(rounds)
    refused: dict[int, PortError] = {}
    for _ in range(times):
        for baud, families in plan:
            try:
                bus.do(everyone_off(baud, families, models, id, flush=LONGEST_FLUSH if times > 1 else 0.0))
            except PortLost:
                raise
            except PortError as error:  # an adapter that cannot have this speed: at the others servos are still told
                refused[baud] = error
        # The second time the other way round: what servos heard before it at another speed is another thing then.
        plan.reverse()
    for why in refused.values():
        note(f"servobus: nobody was told there: {why}")


def _odd(where: Where, rounds: Rounds) -> Rounds:
    """Give the speeds that servos can be set to as well, but seldom are."""
    odd = [(family, spare_bauds(where.models_of(family), bauds)) for family, bauds in rounds]
    return [(family, bauds) for family, bauds in odd if bauds]


def _ids(ids: Sequence[int]) -> str:
    return f"id{'s' * (len(ids) > 1)} {', '.join(map(str, ids))}"
