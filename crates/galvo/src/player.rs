//! Plays commands and gates through a head: where and when every pulse lands.

use std::collections::VecDeque;

use lasergym_geom::Point;

use crate::axis::AxisTracker;
use crate::laser::Gate;
use crate::scan_head::ScanHead;
use crate::servo::Ramp;

/// A pulse on the workpiece.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PulseLanding {
    /// When it fires, µs from the start.
    pub time_us: f64,
    /// Where it lands, µm.
    pub position_um: Point,
    /// Speed of the beam there, m/s.
    pub speed_m_s: f64,
    /// The stroke that it belongs to, from 0.
    pub stroke: u64,
    /// Whether it is the first of an opening of the gate.
    pub first: bool,
    /// Time to the next pulse of the train, µs.
    pub period_us: f64,
}

/// What a stretch of time is for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Purpose {
    /// Along a vector with the laser on, as drawn.
    Mark,
    /// On the way to the next stroke.
    Jump,
    /// Standing still.
    Delay,
    /// Run-in before a stroke or run-out behind it.
    RunIn,
}

/// Where the time goes, s.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct TimeSplit {
    /// Along vectors as drawn.
    pub mark_s: f64,
    /// In jumps.
    pub jump_s: f64,
    /// Standing still.
    pub delay_s: f64,
    /// In run-ins and run-outs.
    pub run_in_s: f64,
}

impl TimeSplit {
    /// The sum.
    #[must_use]
    pub fn total_s(&self) -> f64 {
        self.mark_s + self.jump_s + self.delay_s + self.run_in_s
    }

    fn add(&mut self, purpose: Purpose, duration_us: f64) {
        let slot = match purpose {
            Purpose::Mark => &mut self.mark_s,
            Purpose::Jump => &mut self.jump_s,
            Purpose::Delay => &mut self.delay_s,
            Purpose::RunIn => &mut self.run_in_s,
        };
        *slot += duration_us * 1e-6;
    }
}

/// A head that is being played. Commands and gates go in as they come, pulses come out in order; only
/// what is under way is held in memory.
#[derive(Debug)]
pub struct Player<'a> {
    head: &'a ScanHead,
    x: AxisTracker,
    y: AxisTracker,
    /// Time up to which the command is known, µs.
    clock_us: f64,
    /// Time up to which the mirrors have been followed, µs.
    followed_us: f64,
    /// The command at the clock, µm.
    at_um: Point,
    gates: VecDeque<Gate>,
    /// How far a gate may close before the clock, µs.
    hold_us: f64,
    split: TimeSplit,
    /// Pulses so far.
    fired: u64,
}

/// Most pulses that are fired; later ones are dropped.
pub(crate) const MAX_PULSES: u64 = 200_000_000;

impl<'a> Player<'a> {
    /// A head at rest at `start_um`.
    #[must_use]
    pub fn new(head: &'a ScanHead, start_um: Point) -> Self {
        Self {
            head,
            x: AxisTracker::new(&head.x, start_um.x),
            y: AxisTracker::new(&head.y, start_um.y),
            clock_us: 0.0,
            followed_us: 0.0,
            at_um: start_um,
            gates: VecDeque::new(),
            hold_us: 0.0,
            split: TimeSplit::default(),
            fired: 0,
        }
    }

    /// Puts the head to rest at `start_um`, before anything has moved.
    pub(crate) fn set_start(&mut self, start_um: Point) {
        *self = Self { hold_us: self.hold_us, ..Self::new(self.head, start_um) };
    }

    /// From now on gates close at most `hold_us` before the clock.
    pub fn hold_at_least(&mut self, hold_us: f64) {
        self.hold_us = self.hold_us.max(hold_us);
    }

    /// Time up to which the command is known, µs.
    #[must_use]
    pub fn clock_us(&self) -> f64 {
        self.clock_us
    }

    /// The command at the clock, µm.
    #[must_use]
    pub fn at_um(&self) -> Point {
        self.at_um
    }

    /// Where the time has gone.
    #[must_use]
    pub fn split(&self) -> TimeSplit {
        self.split
    }

    /// The command goes straight to `to_um` in `duration_us`; nothing happens at 0 µs.
    pub fn advance(&mut self, to_um: Point, duration_us: f64, purpose: Purpose) {
        if duration_us <= 0.0 {
            return;
        }
        let from = self.at_um;
        let speed = (to_um - from) * duration_us.recip();
        self.x.command(Ramp { start_um: from.x, speed: speed.x, duration_us });
        self.y.command(Ramp { start_um: from.y, speed: speed.y, duration_us });
        self.clock_us += duration_us;
        self.at_um = to_um;
        self.split.add(purpose, duration_us);
    }

    /// Stands still for `duration_us`.
    pub fn wait(&mut self, duration_us: f64) {
        self.advance(self.at_um, duration_us, Purpose::Delay);
    }

    /// Signals the gate to open at `on_us`, with pulses every `period_us`.
    pub fn open_gate(&mut self, on_us: f64, period_us: f64, stroke: u64) {
        self.gates.push_back(Gate::open(&self.head.laser, on_us, period_us, stroke));
    }

    /// Signals the gate that was opened last to close at `off_us`.
    pub fn close_gate(&mut self, off_us: f64) {
        let response_us = self.head.laser.response_us;
        if let Some(gate) = self.gates.back_mut() {
            gate.off_us = Some(off_us + response_us);
        }
    }

    /// Hands the pulses that are certain by now to `sink`.
    pub fn fire(&mut self, sink: &mut impl FnMut(&PulseLanding)) {
        let train = self.head.laser.train;
        while let Some(gate) = self.gates.front().copied() {
            if self.fired > MAX_PULSES {
                self.gates.clear();
                break;
            }
            let pulse_us = gate.next_pulse_us(train);
            match gate.off_us {
                Some(off_us) if pulse_us > off_us => {
                    self.gates.pop_front();
                    continue;
                }
                None if pulse_us > self.clock_us - self.hold_us => break,
                _ if pulse_us > self.clock_us => break,
                _ => {}
            }
            // Pulses before the previous gate's last ones do not occur: strokes follow each other.
            let step_us = (pulse_us - self.followed_us).max(0.0);
            self.x.advance(step_us);
            self.y.advance(step_us);
            self.followed_us = self.followed_us.max(pulse_us);
            let (x, y) = (self.x.mirror(), self.y.mirror());
            sink(&PulseLanding {
                time_us: pulse_us,
                position_um: self.head.field.landing(Point::new(x.position_um, y.position_um)),
                speed_m_s: x.speed_m_s.hypot(y.speed_m_s),
                stroke: gate.stroke,
                first: gate.fresh,
                period_us: gate.period_us,
            });
            self.fired += 1;
            if let Some(front) = self.gates.front_mut() {
                front.next += 1;
                front.fresh = false;
            }
        }
        if self.gates.is_empty() {
            // Commands that no pulse needs any more are followed, so that they need no memory.
            let step_us = self.clock_us - self.hold_us - self.followed_us;
            if step_us > 0.0 {
                self.x.advance(step_us);
                self.y.advance(step_us);
                self.followed_us += step_us;
            }
        }
    }

    /// Waits until every gate is closed, and hands out the last pulses.
    pub fn finish(&mut self, sink: &mut impl FnMut(&PulseLanding)) {
        let open_until_us =
            self.gates.iter().filter_map(|gate| gate.off_us).fold(self.clock_us, f64::max);
        self.wait(open_until_us - self.clock_us);
        for gate in &mut self.gates {
            gate.off_us.get_or_insert(self.clock_us);
        }
        self.fire(sink);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn landings(head: &ScanHead, play: impl Fn(&mut Player<'_>)) -> Vec<PulseLanding> {
        let mut player = Player::new(head, Point::default());
        play(&mut player);
        let mut pulses = Vec::new();
        player.finish(&mut |pulse| pulses.push(*pulse));
        pulses
    }

    #[test]
    fn pulses_fire_while_the_gate_is_open() {
        let head = ScanHead::default();
        let pulses = landings(&head, |player| {
            player.open_gate(100.0, 20.0, 7);
            player.close_gate(150.0);
            player.advance(Point::new(2000.0, 0.0), 1000.0, Purpose::Mark);
        });
        let times: Vec<f64> = pulses.iter().map(|pulse| pulse.time_us).collect();
        assert_eq!(times, [100.0, 120.0, 140.0]);
        assert!(pulses.iter().all(|pulse| pulse.stroke == 7));
        assert!(pulses[0].first && !pulses[1].first);
    }

    /// Late in a program the clock's last digits are worth more than rounding in a period.
    #[test]
    fn only_one_pulse_of_a_gate_is_the_first() {
        let head = ScanHead::default();
        for k in 0..2000 {
            let on_us = 1e6 + f64::from(k) / 7.0;
            let pulses = landings(&head, |player| {
                player.wait(on_us - 100.0);
                player.open_gate(on_us, 20.0 / 1.001, 0);
                player.close_gate(on_us + 70.0);
                player.wait(300.0);
            });
            let first: Vec<bool> = pulses.iter().map(|pulse| pulse.first).collect();
            assert_eq!(first, [true, false, false, false], "{on_us}");
        }
    }

    #[test]
    fn firing_often_or_once_gives_the_same_pulses() {
        let head = ScanHead::default();
        let play = |often: bool| {
            let mut player = Player::new(&head, Point::default());
            player.hold_at_least(50.0);
            let mut pulses = Vec::new();
            for k in 0..40_u32 {
                let at = f64::from(k);
                player.open_gate(player.clock_us() + 30.0, 7.0, u64::from(k));
                player.advance(Point::new(100.0 * at, 60.0 * at), 100.0, Purpose::Mark);
                player.close_gate(player.clock_us() - 20.0);
                player.wait(13.0);
                if often {
                    player.fire(&mut |pulse| pulses.push(*pulse));
                }
            }
            player.finish(&mut |pulse| pulses.push(*pulse));
            pulses
        };
        let (often, once) = (play(true), play(false));
        assert_eq!(often.len(), once.len());
        for (a, b) in often.iter().zip(&once) {
            assert!(a.position_um.distance(b.position_um) < 1e-9);
        }
    }

    #[test]
    fn time_is_split_by_purpose() {
        let head = ScanHead::default();
        let mut player = Player::new(&head, Point::default());
        player.advance(Point::new(1.0, 0.0), 10.0, Purpose::Mark);
        player.advance(Point::new(2.0, 0.0), 20.0, Purpose::Jump);
        player.advance(Point::new(3.0, 0.0), 30.0, Purpose::RunIn);
        player.wait(40.0);
        let split = player.split();
        assert!((split.total_s() - 1e-4).abs() < 1e-15);
        assert!((split.delay_s - 4e-5).abs() < 1e-15 && (split.run_in_s - 3e-5).abs() < 1e-15);
    }
}
