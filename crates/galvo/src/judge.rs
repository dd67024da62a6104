//! Judges what a program made: lengths, distances of pulses, corners, time, and a map of the energy.

use std::collections::VecDeque;

use lasergym_geom::Point;

use crate::energy_map::EnergyMap;
use crate::head_command::StrokeEnd;
use crate::player::{PulseLanding, TimeSplit};
use crate::watched_head::Observer;

/// What is measured on a stroke.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StrokeMeasure {
    /// Number of the stroke, from 0.
    pub stroke: u64,
    /// Its pulses.
    pub pulses: u64,
    /// Speed, m/s.
    pub speed_m_s: f64,
    /// How far the first crater's edge lies beyond the drawn start, along the stroke, µm.
    pub start_error_um: f64,
    /// How far the last crater's edge lies beyond the drawn end, along the stroke, µm.
    pub end_error_um: f64,
    /// How much the stroke is too long, µm: end minus start error.
    pub length_error_um: f64,
    /// Smallest distance of neighbouring pulses, in nominal ones.
    pub pitch_min: f64,
    /// Largest distance of neighbouring pulses, in nominal ones.
    pub pitch_max: f64,
    /// Largest distance of a pulse from the drawn line, µm; NaN for a stroke with corners.
    pub lateral_error_um: f64,
}

/// What is measured on a program. Pitches are 1 where pulses are speed/rate apart; NaN where there is
/// nothing to measure.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Report {
    /// Strokes with a pulse.
    pub strokes: u64,
    /// Strokes without one.
    pub empty_strokes: u64,
    /// All pulses.
    pub pulses: u64,
    /// Largest |length error|, µm.
    pub length_error_um_max: f64,
    /// Mean length error, µm.
    pub length_error_um_mean: f64,
    /// Standard deviation of the length errors, µm.
    pub length_error_um_deviation: f64,
    /// Largest |start error| or |end error|, µm.
    pub edge_error_um_max: f64,
    /// Largest distance of a pulse of a straight stroke from the drawn line, µm.
    pub lateral_error_um_max: f64,
    /// Smallest pitch.
    pub pitch_min: f64,
    /// Largest pitch.
    pub pitch_max: f64,
    /// Standard deviation of the pitch.
    pub pitch_deviation: f64,
    /// Most pulses within half a crater of one, over those of a straight line, away from corners.
    pub overburn_max: f64,
    /// The same at corners of strokes.
    pub corner_overburn_max: f64,
    /// Where the time goes.
    pub time: TimeSplit,
}

/// Pulses of a stroke that are kept for counting neighbours.
const WINDOW: usize = 512;

/// Running sums of a quantity.
#[derive(Debug, Clone, Copy)]
struct Sums {
    count: u64,
    sum: f64,
    squares: f64,
    least: f64,
    most: f64,
}

impl Sums {
    const NONE: Self =
        Self { count: 0, sum: 0.0, squares: 0.0, least: f64::INFINITY, most: f64::NEG_INFINITY };

    fn add(&mut self, value: f64) {
        self.count += 1;
        self.sum += value;
        self.squares += value * value;
        self.least = self.least.min(value);
        self.most = self.most.max(value);
    }

    fn mean(&self) -> f64 {
        self.sum / self.count as f64
    }

    fn deviation(&self) -> f64 {
        (self.squares / self.count as f64 - self.mean().powi(2)).max(0.0).sqrt()
    }

    fn range(&self) -> (f64, f64) {
        if self.count == 0 { (f64::NAN, f64::NAN) } else { (self.least, self.most) }
    }
}

/// Measures a program while it runs, in constant memory.
#[derive(Debug)]
pub struct Judge<F> {
    spot_um: f64,
    on_stroke: F,
    /// Strokes whose pulses may still come.
    waiting: VecDeque<Waiting>,
    first: Option<PulseLanding>,
    last: Option<PulseLanding>,
    pitches: Sums,
    recent: VecDeque<Point>,
    all_pitches: Sums,
    lengths: Sums,
    edges: Sums,
    laterals: Sums,
    lateral_um: f64,
    strokes: u64,
    empty: u64,
    stroke_pulses: u64,
    overburn: f64,
    corner_overburn: f64,
    map: Option<EnergyMap>,
}

#[derive(Debug, Clone)]
struct Waiting {
    start: StrokeEnd,
    end: Option<StrokeEnd>,
    /// Places, and how far around them the beam rounds them off, µm.
    corners: VecDeque<(Point, f64)>,
    /// Whether it has or had a corner.
    cornered: bool,
}

impl<F: FnMut(&StrokeMeasure)> Judge<F> {
    /// A judge for craters of `spot_um`; each stroke is handed to `on_stroke`, each pulse put into
    /// `map`.
    pub fn new(spot_um: f64, map: Option<EnergyMap>, on_stroke: F) -> Self {
        Self {
            spot_um,
            on_stroke,
            waiting: VecDeque::new(),
            first: None,
            last: None,
            pitches: Sums::NONE,
            recent: VecDeque::new(),
            all_pitches: Sums::NONE,
            lengths: Sums::NONE,
            edges: Sums::NONE,
            laterals: Sums::NONE,
            lateral_um: 0.0,
            strokes: 0,
            empty: 0,
            stroke_pulses: 0,
            overburn: 0.0,
            corner_overburn: 0.0,
            map,
        }
    }

    /// The report, after the program has finished, and the map.
    pub fn report(mut self, time: TimeSplit, pulses: u64) -> (Report, Option<EnergyMap>) {
        while !self.waiting.is_empty() {
            self.end_stroke();
        }
        let (pitch_min, pitch_max) = self.all_pitches.range();
        let (shortest, longest) = self.lengths.range();
        let (edge_low, edge_high) = self.edges.range();
        let report = Report {
            strokes: self.strokes,
            empty_strokes: self.empty,
            pulses,
            length_error_um_max: shortest.abs().max(longest.abs()),
            length_error_um_mean: self.lengths.mean(),
            length_error_um_deviation: self.lengths.deviation(),
            edge_error_um_max: edge_low.abs().max(edge_high.abs()),
            lateral_error_um_max: self.laterals.range().1,
            pitch_min,
            pitch_max,
            pitch_deviation: self.all_pitches.deviation(),
            overburn_max: self.overburn,
            corner_overburn_max: self.corner_overburn,
            time,
        };
        (report, self.map)
    }

    fn end_stroke(&mut self) {
        let Some(stroke) = self.waiting.pop_front() else { return };
        let (first, last) = (self.first.take(), self.last.take());
        self.recent.clear();
        let pulses = std::mem::take(&mut self.stroke_pulses);
        let pitches = std::mem::replace(&mut self.pitches, Sums::NONE);
        let lateral_um = std::mem::take(&mut self.lateral_um);
        let (Some(first), Some(last), Some(end)) = (first, last, stroke.end) else {
            self.empty += 1;
            return;
        };
        let along = |pulse: &PulseLanding, end: &StrokeEnd| {
            let way = pulse.position_um - end.at_um;
            way.x * end.direction.x + way.y * end.direction.y
        };
        let start_error_um = along(&first, &stroke.start) - 0.5 * stroke.start.beam_um;
        let end_error_um = along(&last, &end) + 0.5 * end.beam_um;
        let (pitch_min, pitch_max) = pitches.range();
        let measure = StrokeMeasure {
            stroke: stroke.start.stroke,
            pulses,
            speed_m_s: stroke.start.speed_m_s,
            start_error_um,
            end_error_um,
            length_error_um: end_error_um - start_error_um,
            pitch_min,
            pitch_max,
            lateral_error_um: if stroke.cornered { f64::NAN } else { lateral_um },
        };
        if !stroke.cornered {
            self.laterals.add(lateral_um);
        }
        self.strokes += 1;
        self.lengths.add(measure.length_error_um);
        self.edges.add(start_error_um);
        self.edges.add(end_error_um);
        (self.on_stroke)(&measure);
    }

    /// Counts the pulses within half a crater, over those of a straight line.
    fn count_neighbours(&mut self, pulse: &PulseLanding, nominal_um: f64) {
        let reach_um = 0.5 * self.spot_um;
        self.recent.push_back(pulse.position_um);
        if self.recent.len() > WINDOW {
            self.recent.pop_front();
        }
        let near = self
            .recent
            .iter()
            .rev()
            .take_while(|place| place.distance(pulse.position_um) <= 2.0 * reach_um)
            .filter(|place| place.distance(pulse.position_um) <= reach_um)
            .count();
        // Behind the newest pulse of a straight line lie as many as fit into the reach.
        let straight = 1.0 + (reach_um / nominal_um + 1e-9).floor();
        let ratio = near as f64 / straight;
        let at_corner = self.waiting.front_mut().is_some_and(|stroke| {
            stroke.corners.iter().any(|(corner, reach_um)| {
                corner.distance(pulse.position_um) <= self.spot_um.max(*reach_um)
            })
        });
        let slot = if at_corner { &mut self.corner_overburn } else { &mut self.overburn };
        *slot = slot.max(ratio);
    }
}

impl<F: FnMut(&StrokeMeasure)> Observer for Judge<F> {
    fn stroke_begins(&mut self, start: &StrokeEnd) {
        self.waiting.push_back(Waiting {
            start: *start,
            end: None,
            corners: VecDeque::new(),
            cornered: false,
        });
    }

    fn corner(&mut self, stroke: u64, at_um: Point, reach_um: f64) {
        if let Some(waiting) = self.waiting.iter_mut().rev().find(|w| w.start.stroke == stroke) {
            waiting.cornered = true;
            waiting.corners.push_back((at_um, reach_um));
            if waiting.corners.len() > 16 {
                waiting.corners.pop_front();
            }
        }
    }

    fn stroke_ends(&mut self, end: &StrokeEnd) {
        if let Some(waiting) = self.waiting.iter_mut().rev().find(|w| w.start.stroke == end.stroke)
        {
            waiting.end = Some(*end);
        }
    }

    fn pulse(&mut self, pulse: &PulseLanding) {
        while self.waiting.front().is_some_and(|stroke| stroke.start.stroke < pulse.stroke) {
            self.end_stroke();
        }
        if let Some(map) = &mut self.map {
            map.add(pulse.position_um);
        }
        let speed_m_s = self.waiting.front().map_or(0.0, |stroke| stroke.start.speed_m_s);
        let nominal_um = speed_m_s * pulse.period_us;
        if let Some(last) = self.last.filter(|_| !pulse.first && nominal_um > 0.0) {
            let pitch = last.position_um.distance(pulse.position_um) / nominal_um;
            self.pitches.add(pitch);
            self.all_pitches.add(pitch);
        }
        if self.spot_um > 0.0 && nominal_um > 0.0 {
            self.count_neighbours(pulse, nominal_um);
        }
        if let Some(stroke) = self.waiting.front() {
            let way = pulse.position_um - stroke.start.at_um;
            let toward = stroke.start.direction;
            let beside_um = toward.x * way.y - toward.y * way.x;
            self.lateral_um = self.lateral_um.max(beside_um.abs());
        }
        self.first.get_or_insert(*pulse);
        self.last = Some(*pulse);
        self.stroke_pulses += 1;
    }
}
