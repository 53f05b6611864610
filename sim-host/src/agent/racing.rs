//! How far agents are on their courses.

use core::ops::Range;

use kestrel_core::real::Real;
use nalgebra::Vector3;

use super::{Agent, length};
use crate::course::{Gate, GatesAhead};
use crate::latency::known_states;
use crate::scenario::Scenario;
use crate::swarm::{Column, row, set_row, vector};

/// What is left of the course of an agent, by lane.
#[derive(Clone, Debug)]
pub(super) struct Race<const LANES: usize, R> {
    /// Gates to pass, the next one included.
    left: Column<LANES, R>,
    /// Where the drone was one control period ago \[m, world\].
    before: [Column<LANES, R>; 3],
}

impl<const LANES: usize, R: Real> Race<LANES, R> {
    pub(super) fn new() -> Self {
        Self { left: [R::zero(); LANES], before: [[R::zero(); LANES]; 3] }
    }

    pub(super) fn left(&self) -> &Column<LANES, R> {
        &self.left
    }

    pub(super) fn columns_mut(&mut self) -> impl Iterator<Item = &mut Column<LANES, R>> {
        [&mut self.left].into_iter().chain(&mut self.before)
    }

    /// The next of these gates, which are not passed yet in a lane, and those behind it.
    fn ahead<'a>(&self, gates: &'a [Gate], lane: usize) -> &'a [Gate] {
        &gates[gates.len() - self.left[lane].to_f64() as usize..]
    }
}

impl<const LANES: usize, R: Real> Agent<LANES, R> {
    /// Puts the drone of a lane before the first gate.
    pub(super) fn line_up(&mut self, scenario: &Scenario, lane: usize) {
        let gates = scenario.aviary_of(self.room(lane)).gates.len();
        if let Some(race) = &mut self.race {
            race.left[lane] = R::from_f64(gates as f64);
            set_row(&mut race.before, lane, row(&self.swarm.position, lane));
        }
    }

    /// Turns to the next gate where one was passed. The distance of the step before then counts to the next gate as well, by
    /// way of the one that was passed, so that what came nearer is progress along the course.
    #[inline(always)]
    pub(super) fn pass_gates(&mut self, scenario: &Scenario) {
        let Some(mut race) = self.race.take() else { return };
        for lane in 0..LANES {
            let ahead = race.ahead(&scenario.aviary_of(self.room(lane)).gates, lane);
            let (before, now) = (vector(&race.before, lane), vector(&self.swarm.position, lane));
            let Some((gate, behind)) = ahead.split_first() else { continue };
            if gate.is_passed(&before.map(Real::to_f64), &now.map(Real::to_f64)) {
                race.left[lane] -= R::one();
                if let Some(next) = behind.first() {
                    let leg: Vector3<R> = (next.center - gate.center).map(R::from_f64);
                    self.previous_distances[lane] += length(&leg);
                    set_row(&mut self.goal, lane, next.center.map(R::from_f64).into());
                }
            }
            set_row(&mut race.before, lane, now.into());
        }
        self.race = Some(race);
    }

    /// Shows drones the next gates.
    #[inline(always)]
    pub(super) fn look_at_gates(&mut self, seen: &GatesAhead, scenario: &Scenario, lanes: Range<usize>) {
        let Some(race) = &self.race else { return };
        let known = known_states(&self.swarm, self.latency.as_ref());
        let per_metre = R::one() / R::from_f32(seen.position_scale_m);
        let first = self.measurements.len() - seen.len();
        for lane in lanes {
            let gates = &scenario.aviary_of(self.room(lane)).gates;
            let ahead = race.ahead(gates, lane);
            let position = known.state(lane).position.map(Real::to_f64);
            let columns = self.measurements[first..].as_chunks_mut::<{ GatesAhead::GATE_LEN }>().0;
            for (number, columns) in columns.iter_mut().enumerate() {
                let Some(gate) = ahead.get(number).or(gates.last()) else { continue };
                let place = gate.seen(&position).map(R::from_f64);
                let forward = gate.forward().map(R::from_f64);
                let [x, y, z] = [place.x, place.y, place.z].map(|metres| metres * per_metre);
                set_row(columns, lane, [x, y, z, forward.x, forward.y]);
            }
        }
    }
}
