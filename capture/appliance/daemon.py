"""The daemon: one loop that polls the sensor, the button, the control socket and the disk thread 30 times a second.

The loop never blocks. The disk and the opening of the sensor have threads; clients have a non-blocking socket.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from capture.appliance.config import InForce
from capture.appliance.config_tables import CONTOUR
from capture.appliance.control import ControlServer
from capture.appliance.disk import Disk, DiskNews
from capture.appliance.faults import FaultBook
from capture.appliance.log import LOG
from capture.appliance.panel import Panel
from capture.appliance.pre_roll import PreRoll
from capture.appliance.preview import Preview
from capture.appliance.running_take import TakeInProgress
from capture.appliance.sensor_keeper import SensorKeeper
from capture.appliance.showing import Light, lamp_signal
from capture.appliance.states import WITH_TAKE, Event, State, StateMachine
from capture.appliance.status import Counts, report
from capture.appliance.sync_news import SyncNews
from capture.recording.condition import Condition
from capture.recording.frame_reader import FrameReader, ScanPlan, Seen
from capture.recording.session import LEAST_ROOM
from capture.recording.tracking import FrameTracker
from firmware_host.depth_sensor import SensorFrame
from firmware_host.errors import SensorStalledError
from firmware_host.power import PowerSupply
from formats.errors import HangtimeError, OutputError
from formats.plain_text import with_advice

WAIT = 0.07  # s that the loop waits for a frame: a press must count within 100 ms
RESTING = {State.READY, State.SYNCING, State.FAULT}  # states in which only an occasional frame is processed
LOOK_EVERY = 1.1  # s between searches for a hanger; our choice: half and double change its delay and the load alone
# s without the hanger after which the pre-roll is discarded. Our choice: longer than a hand covers the hanger while
# it hangs a garment. Half and double were not tried.
GONE_AFTER = 5.0
KEEP_HOUSE = 1.0  # s between checks of disk, voltage and sync; our choice: it delays a fault on the lamp, nothing else
TRY_AGAIN = 2.0  # s between attempts to use a failed spool; our choice: it delays the use of a mended disk alone
# s that a running take has to reach the disk when the daemon is stopped. Our choice: two thirds of TimeoutStopSec in
# systemd/system/hangtime-capture.service, which kills the daemon.
LONGEST_SHUTDOWN = 20.0


class Appliance:
    """The appliance's control loop and its state; `step` is one iteration."""

    def __init__(
        self, in_force: InForce, *, keeper: SensorKeeper, disk: Disk, control: ControlServer,
        clock: Callable[[], float],
    ) -> None:  # fmt: skip
        self._in_force, self._config, self._clock = in_force, in_force.config, clock
        self._keeper, self._disk, self._control = keeper, disk, control
        self.machine, self.faults, self.counts = StateMachine(), FaultBook(), Counts(begun_s=clock())
        self._panel = Panel(self._config, self.faults)
        self._power = PowerSupply(self._config.power.alarm)
        self._sync = SyncNews(self._config.spool.folder)
        self._preview = Preview()
        self._looker = FrameTracker(in_force.rig, in_force.garment, is_sparing=True)
        self._reader: FrameReader | None = None
        self._pre_roll: PreRoll[Seen] = PreRoll(self._config.recording.pre_roll_s)
        self._take: TakeInProgress | None = None
        self._is_spool_sound = False
        self._has_frames = False
        self._condition = Condition.NO_MARKERS
        self._last_look = self._last_hanger = self._last_house = self._last_try = self._kept_at = -float("inf")
        self._was: tuple[Any, ...] = ()
        if in_force.refused is not None:
            self.faults.set("config", _of_old_settings(in_force.refused), clock())

    def step(self) -> None:
        """Run one iteration, with at most one frame."""
        self._keeper.rest(is_resting=self.machine.state in RESTING)
        frame = self._keeper.next_frame(WAIT)
        now = self._clock()
        if frame is not None:
            self._has_frames = True
            self.faults.clear("sensor")  # a sensor that opens and delivers no frame is still faulty
            self.counts.frames += 1
            self.counts.dropped += frame.dropped_before
            self.counts.gaps += frame.dropped_before > 0
            self._on_frame(frame, now)
        self._look_at_sensor(now)
        for news in self._disk.news():
            self._on_news(news, now)
        self._look_at_disk(now)
        if now - self._last_house >= KEEP_HOUSE:
            self._last_house = now
            self._keep_house(now)
        self._follow_faults()
        for _ in range(self._panel.presses(now)):
            self._on_press(now)
        self._show(now)  # before requests are answered, so that the lamp never lags behind an answer
        self._control.serve(self._answer)

    def _follow(self, event: Event) -> bool:
        """Apply an event to the state machine; log and publish a new state, and return whether there is one."""
        if not self.machine.take(event):
            return False
        LOG.info("%s", self.machine.state.value)
        self._tell_watchers(self._light(self._clock()))
        return True

    @property
    def is_started(self) -> bool:
        """Return whether starting has ended, in readiness or in a fault."""
        return self.machine.state is not State.STARTING

    def shut_down(self) -> None:
        """End a running take and wait until it is on the disk."""
        until = self._clock() + LONGEST_SHUTDOWN
        self._stop("the appliance was stopped")
        while self.machine.state is State.SAVING and self._clock() < until:
            self.step()
        self._panel.close()

    # --- frames --------------------------------------------------------------------------------------

    def _on_frame(self, frame: SensorFrame, now: float) -> None:
        state = self.machine.state
        if state in (State.READY, State.SYNCING):
            if now - self._last_look >= LOOK_EVERY:
                self._last_look = now
                self._look_for_hanger(frame, now)
        elif state in (State.ARMED, State.RECORDING) and self._reader is not None:
            self._on_read(self._reader.read(frame), now)

    def _look_for_hanger(self, frame: SensorFrame, now: float) -> None:
        sight = self._looker.track(frame, now)
        self._preview.keep(frame, sight)
        if sight.hanger.is_found and self._follow(Event.HANGER_SEEN):
            self._begin_reading()
            self._last_hanger = now

    def _begin_reading(self) -> None:
        info, part = self._keeper.info, self._config.recording
        if info is None:
            return
        scans = None
        if part.scan_rate_hz > 0:
            scans = ScanPlan(rate=part.scan_rate_hz, grid=part.scan_points, contour=CONTOUR * part.scan_points)
        self._reader = FrameReader(info, self._in_force.rig, self._in_force.garment, scans=scans)
        self._pre_roll.take()

    def _on_read(self, seen: Seen | None, now: float) -> None:
        if seen is None or self._reader is None:
            self._condition = Condition.CLOCK
            if self._take is not None:
                self._take.tally.add_unplaced(self._reader.now if self._reader else 0.0)
            return
        if self._reader.frame is not None and self._reader.sight is not None:
            self._preview.keep(self._reader.frame, self._reader.sight)
        self._condition = seen.condition
        self._last_hanger = now if seen.has_hanger else self._last_hanger
        if self._take is None:
            self._pre_roll.add(seen)
            if now - self._last_hanger > GONE_AFTER and self._follow(Event.HANGER_GONE):
                self._forget_frames()
            return
        self._take.count(seen, self._reader.frame)
        self._condition = self._take.condition
        self._disk.add(seen)
        if self._take.seconds_since_press >= self._config.recording.longest_s:
            self._stop("longest_s of the configuration")

    def _forget_frames(self) -> None:
        self._reader = None
        self._pre_roll.take()

    # --- start and stop ------------------------------------------------------------------------------

    def _on_press(self, now: float) -> None:
        if self.machine.state is State.RECORDING:
            self._stop("button")
        else:
            self._start("button", now)

    def _start(self, by: str, now: float) -> dict[str, Any]:
        """Begin a take; return the answer to the request, which says that it has begun or why it cannot."""
        if not self.machine.may_record:
            return self._why_not()
        before = self._pre_roll.take()
        if self._reader is None:
            self._begin_reading()
        info = self._keeper.info
        if self._reader is None or info is None:
            return self._why_not()
        self._follow(Event.START)
        garment = self._in_force.garment
        self._take = TakeInProgress(self._reader, before, len(garment.points), by=by, now=now)
        self._disk.begin(self._take.plan(self._in_force.rig, garment, info.uri))
        for seen in before:
            self._disk.add(seen)
        LOG.info("recording, begun by %s, with %.2f s before it", by, self._take.beginning.pre_roll_s)
        return {"ok": True}

    def _why_not(self) -> dict[str, Any]:
        state = self.machine.state
        if self.faults.blocking:
            fault = self.faults.blocking[0]
            return _no(f"nothing can be recorded: {fault.sentence}", fault.advice)
        if state is State.RECORDING:
            return _no("a take is being recorded already", "`hangtime stop` ends the take")
        return _no(f"no take can begin now: {state.value}", "try again in a moment")

    def _stop(self, ended_by: str, event: Event = Event.STOP) -> bool:
        """End the running take; return whether there was one."""
        if self._take is None or not self._follow(event):
            return False
        take, self._take = self._take, None
        self._disk.end(take.facts(ended_by), is_worth_keeping=take.is_worth_keeping, shown=take.shown)
        if not take.is_worth_keeping:
            tally = take.tally
            worst = tally.conditions.worst.value
            self.counts.last_take = {
                "kept": None, "findings": [{
                    "name": "nothing_kept", "is_grave": True,
                    "words": f"nothing was kept: both hanger markers were seen in {tally.with_hanger} of "
                    f"{tally.frames} frames, mostly because: {worst.words}",
                    "advice": worst.advice or "record longer",
                }],
            }  # fmt: skip
        LOG.info("recorded %d frames in %.2f s, ended by %s", take.tally.frames, take.tally.seconds, ended_by)
        self._forget_frames()
        return True

    # --- faults -------------------------------------------------------------------------------------

    def _look_at_sensor(self, now: float) -> None:
        silent, info = self._keeper.silent_s(now), self._keeper.info
        if silent is None or info is None:
            self.faults.clear("sensor_silent")
        else:
            error = SensorStalledError(
                f"the sensor has sent no frame for {silent:.1f} s", where=info.uri,
                advice="check the sensor's cable; the recorder tries the sensor again",
            )  # fmt: skip
            self.faults.set("sensor_silent", self._blamed(error, now), now)
        if self._keeper.error is None:
            return
        self._has_frames = False
        self.faults.set("sensor", self._blamed(self._keeper.error, now), now, blocks=True)

    def _blamed(self, error: HangtimeError, now: float) -> HangtimeError:
        """Attribute a sensor's fault to the power supply if the board's voltage was low."""
        if not self._power.was_low(now):
            return error
        return type(error)(
            f"{error.what}, after the board's voltage was too low", where=error.where,
            advice="use a stronger power supply and a shorter cable: USB devices drop out when the voltage sinks",
        )  # fmt: skip

    def _look_at_disk(self, now: float) -> None:
        behind = self._disk.behind(now)
        if behind > self._config.spool.slowest_s:
            error = OutputError(
                f"the disk has not finished writing for {behind:.1f} s", where=self._config.spool.folder,
                advice="use a faster card, or replace one that is worn out",
            )  # fmt: skip
            self._set_disk_fault("disk_slow", error, now)
        is_wrong = "disk" in self.faults or "disk_slow" in self.faults or not self._is_spool_sound
        if is_wrong and self._disk.is_idle and now - self._last_try >= TRY_AGAIN:
            self._last_try = now
            self._disk.salvage()

    def _set_disk_fault(self, name: str, error: HangtimeError, now: float) -> None:
        self._is_spool_sound = False
        self.faults.set(name, error, now, blocks=True)

    def _on_news(self, news: DiskNews, now: float) -> None:
        if news.failure is not None:
            self._set_disk_fault("disk", news.failure, now)
        if news.room is not None:
            self._on_room(news.room, now)
        if news.counts is not None:
            self.counts.takes, self.counts.waiting = news.counts
        for kept in news.salvaged:
            self.counts.salvaged += 1
            LOG.warning("%s: %s", kept.path, kept.facts.get("salvaged"))
        if news.is_sound:
            self._is_spool_sound = True
            self.faults.clear("disk")
            self.faults.clear("disk_slow")
        if news.kept is not None:
            self._kept_at = now
            self.counts.bytes_kept += news.kept.size
            self.counts.last_take = {
                "kept": str(news.kept.path), "sequence": news.kept.sequence, "seconds": news.kept.facts.get("seconds"),
                "findings": [finding.as_fact() for finding in news.findings],
            }  # fmt: skip
            LOG.info("kept %s", news.kept.path)
            for finding in news.findings:
                LOG.warning("%s: %s", news.kept.stem, with_advice(finding.words, finding.advice))
        if news.is_over:
            self._follow(Event.SAVED)

    def _on_room(self, room: int, now: float) -> None:
        self.counts.free_bytes = room
        least = LEAST_ROOM if self.machine.state in WITH_TAKE else self._config.spool.least_free_mb * 1_000_000
        if room >= least:
            self.faults.clear("disk_full")
            return
        error = OutputError(
            f"only {room / 1e6:.0f} MB are left on the disk", where=self._config.spool.folder,
            advice=f"make room for {self._config.spool.least_free_mb} MB, or let `hangtime sync` send takes away",
        )  # fmt: skip
        self.faults.set("disk_full", error, now, blocks=True)

    def _keep_house(self, now: float) -> None:
        self._disk.look()  # during a take, too, whose frames leave the disk's thread idle for moments alone
        if self._power.was_low(now):
            error = OutputError(
                "the board's voltage was too low within the last minute",
                where="power supply",
                advice="use a stronger power supply and a shorter cable",
            )
            self.faults.set("power", error, now)
        else:
            self.faults.clear("power")
        self._sync.look()
        if self._sync.error is None:
            self.faults.clear("sync")
        else:
            self.faults.set("sync", self._sync.error, now)
        self._follow(Event.SYNC_BEGAN if self._sync.is_sending else Event.SYNC_ENDED)

    def _follow_faults(self) -> None:
        blocking = self.faults.blocking
        if blocking:
            if self.machine.state is State.RECORDING:
                self._stop(blocking[0].sentence, Event.FAULTY)
            elif self._follow(Event.FAULTY):
                self._forget_frames()
        elif self._is_spool_sound and self._has_frames:
            self._follow(Event.SOUND)

    # --- answers -------------------------------------------------------------------------------------

    def _answer(self, question: dict[str, Any]) -> dict[str, Any]:
        do = question.get("do")
        if do == "start":
            return self._start("command", self._clock())
        if do == "stop":
            if self._stop("command"):
                return {"ok": True}
            return _no("nothing is being recorded", "`hangtime start` begins a take")
        if do == "status":
            return {"ok": True} | self.status()
        if do == "preview":
            return {"ok": True} | self._preview.answer()
        return _no(f"the recorder does not know {do!r}", "update Hangtime on both sides")

    def status(self) -> dict[str, Any]:
        """Return what `hangtime status --json` prints."""
        now = self._clock()
        return report(
            state=self.machine.state, faults=self.faults, counts=self.counts, now=now,
            light=self._light(now), running=None if self._take is None else self._take.now(),
            condition=self._condition, pre_roll_s=self._pre_roll.span, behind_s=self._disk.behind(now),
            sync=self._sync.for_status(), config=self._in_force,
        )  # fmt: skip

    def _light(self, now: float) -> Light:
        is_tracking = self._condition is Condition.GOOD and "sensor_silent" not in self.faults
        findings = self.counts.last_take.get("findings") if self.counts.last_take else None
        return lamp_signal(
            self.machine.state, is_tracking=is_tracking, behind_s=self._disk.behind(now),
            kept_ago_s=now - self._kept_at, has_complaint=bool(self.faults.all or findings),
        )  # fmt: skip

    def _show(self, now: float) -> None:
        light = self._light(now)
        self._panel.show(light, now)
        self._tell_watchers(light)

    def _tell_watchers(self, light: Light) -> None:
        """Send the status to the watchers if it has changed."""
        faults = tuple(fault.name for fault in self.faults.all)
        is_now = (self.machine.state, light, self._condition, faults)
        if is_now != self._was:
            self._was = is_now
            if self._control.is_watched:
                self._control.tell(self.status())


def _no(what: str, advice: str) -> dict[str, Any]:
    """Return the answer to a command that cannot be carried out."""
    return {"ok": False, "what": what, "advice": advice}


def _of_old_settings(refused: HangtimeError) -> HangtimeError:
    """Return the fault of a settings file that was refused; a file that is mended counts from the next start on."""
    return type(refused)(
        f"{refused.what} (the last valid settings are in force)", where=refused.where,
        advice=f"{refused.advice or 'mend it'}; then `systemctl restart hangtime-capture`",
    )  # fmt: skip
