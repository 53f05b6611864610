//! The execution of a mission: a state machine that is told where the drone is and says what to do next.

use nalgebra::Vector3;

use super::MISSION_ITEMS;
use super::place::MissionTarget;
use super::step::{
    AfterStep, LoiterTime, MissionCircle, MissionLeg, MissionSpeed, MissionStep, MissionTurn, TurningSense,
};

/// Distance at which a point counts as reached if the sender leaves it open \[m\]: as far as a hovering drone strays.
const RADIUS_M: f32 = 0.2;

/// No radius of a sender is taken smaller than this \[m\]: the drone might pass a tighter one for ever.
const LEAST_RADIUS_M: f32 = 0.1;

/// The nose points where it should, up to this \[rad\].
const TURNED_RAD: f32 = 0.1;

/// Nobody waits longer for a nose to turn \[s\]: some policies see no heading, and never turn.
const TURN_SECS: f64 = 10.0;

/// On a circle the drone follows a place so far ahead \[m\], but no farther around than this \[rad\].
const AHEAD_M: f32 = 0.3;
const AHEAD_RAD: f32 = 0.5;

/// How far a mission is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MissionPhase {
    /// It waits for its start.
    NotStarted,
    /// It is flown.
    Active,
    /// It waits to go on.
    Paused,
    /// It is over.
    Complete,
}

/// Where the drone is, as the mission sees it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MissionInput {
    /// Of the drone \[m, world\].
    pub position: Vector3<f32>,
    /// Where its nose points, counter-clockwise from the world's x axis \[rad\].
    pub heading: f32,
    /// What it does.
    pub motion: DroneMotion,
    /// Simulated time \[s\].
    pub secs: f64,
}

/// What the drone does.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DroneMotion {
    /// It is on the ground: not taken off yet, or landed.
    OnGround,
    /// It flies, and its goal moves: it climbs or travels.
    Travelling,
    /// It flies, and its goal rests.
    Resting,
}

/// What to do now. The same one comes with every tick until it is done, so the caller may act on changes only.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Directive {
    /// Take off to a height \[m, world\], or to the vehicle's own.
    TakeOff {
        /// Height of the top, if the mission names it.
        altitude_m: Option<f32>,
    },
    /// Go to a point, and stay there.
    HeadFor {
        /// The point \[m, world\].
        point: Vector3<f32>,
        /// How fast \[m/s\], if the mission says; the vehicle's own limits hold.
        speed: Option<f32>,
        /// Where the nose shall point \[rad\], if the mission says.
        heading: Option<f32>,
    },
    /// Stay here and point the nose \[rad\].
    Face {
        /// Counter-clockwise from the world's x axis.
        heading: f32,
    },
    /// Stay here.
    Wait,
    /// Fly home and land.
    Return,
    /// Land here.
    Land,
    /// The mission is over: stay here.
    Done,
}

/// Executes the legs of a mission, which are given with every call: a caller that replaces them calls [`MissionRunner::reset`].
///
/// Landed or disarmed against its will the drone would be commanded to take off again: a caller that has it land calls
/// [`MissionRunner::pause`] first.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MissionRunner {
    phase: MissionPhase,
    current: u16,
    stage: Stage,
    speed: Option<f32>,
    /// How often the jump of each item was made.
    jumps: [u16; MISSION_ITEMS],
}

/// How far the current step is.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Stage {
    /// It has not begun.
    New,
    /// The drone takes off for it.
    TakingOff,
    /// The drone is on its way to a point.
    Travelling { point: Vector3<f32> },
    /// The drone has come to the place and stays from a time on \[s\].
    Staying { at: Option<Vector3<f32>>, since_secs: f64 },
    /// It turns its nose, from a time on \[s\].
    Turning { heading: f32, since_secs: f64 },
    /// It flies around a point, at a height \[m\]: where it is seen from there \[rad\], and how far it has come \[rad\].
    Circling { center: Vector3<f32>, bearing: f32, swept: f32 },
    /// It stays until told.
    Loitering { at: Vector3<f32> },
    /// It has been told.
    Continued,
}

impl Default for MissionRunner {
    fn default() -> Self {
        Self {
            phase: MissionPhase::NotStarted,
            current: 0,
            stage: Stage::New,
            speed: None,
            jumps: [0; MISSION_ITEMS],
        }
    }
}

impl MissionRunner {
    /// How far the mission is.
    pub fn phase(&self) -> MissionPhase {
        self.phase
    }

    /// The item that is flown, or would be; the last one when all are.
    pub fn current(&self) -> u16 {
        self.current
    }

    /// Forgets the mission: there is another one, or none.
    pub fn reset(&mut self) {
        *self = Self::default();
    }

    /// Starts at the current item, or anew if the mission is over. Whether there is anything to fly.
    pub fn start(&mut self, legs: &[MissionLeg]) -> bool {
        if legs.is_empty() {
            return false;
        }
        if self.phase == MissionPhase::Complete {
            self.reset();
        }
        self.phase = MissionPhase::Active;
        true
    }

    /// Stops where the drone is; a step that is interrupted begins anew afterwards.
    pub fn pause(&mut self) {
        if self.phase == MissionPhase::Active {
            self.phase = MissionPhase::Paused;
            self.stage = Stage::New;
        }
    }

    /// Goes on after a pause, or after loitering until told.
    pub fn resume(&mut self) {
        match (self.phase, self.stage) {
            (MissionPhase::Paused, _) => self.phase = MissionPhase::Active,
            (MissionPhase::Active, Stage::Loitering { .. }) => self.stage = Stage::Continued,
            (MissionPhase::NotStarted | MissionPhase::Active | MissionPhase::Complete, _) => {}
        }
    }

    /// Makes an item the current one; a mission that is flown goes on from there. Whether there is such an item.
    pub fn jump(&mut self, sequence: u16, legs: &[MissionLeg]) -> bool {
        if usize::from(sequence) >= legs.len() {
            return false;
        }
        self.current = sequence;
        self.stage = Stage::New;
        if self.phase == MissionPhase::Complete {
            self.phase = MissionPhase::NotStarted;
        }
        true
    }

    /// What to do now; `reached` gets every item that is done, once.
    pub fn advance(
        &mut self,
        legs: &[MissionLeg],
        situation: &MissionInput,
        reached: &mut dyn FnMut(u16),
    ) -> Directive {
        let known = situation.position.iter().all(|coordinate| coordinate.is_finite());
        // Jumps may lead round and round through items that take no time.
        for _ in 0..=2 * legs.len() {
            if self.phase != MissionPhase::Active || !known {
                break;
            }
            let Some(leg) = legs.get(usize::from(self.current)) else {
                self.phase = MissionPhase::Complete;
                break;
            };
            if let MissionStep::Jump { to, times } = leg.step
                && self.jumps(to, times)
            {
                continue;
            }
            match self.fly(&leg.step, situation) {
                Some(Directive::HeadFor { point, speed, .. }) => {
                    return Directive::HeadFor { point, speed, heading: leg.heading };
                }
                Some(directive) => return directive,
                None => {}
            }
            reached(self.current);
            self.proceed(leg.after, legs.len());
        }
        if self.phase == MissionPhase::Complete { Directive::Done } else { Directive::Wait }
    }

    /// Goes to another leg, unless it did so often enough; then it may do so as often again when it comes here anew.
    fn jumps(&mut self, to: u16, times: Option<u16>) -> bool {
        let Some(made) = self.jumps.get_mut(usize::from(self.current)) else { return false };
        if times.is_some_and(|times| *made >= times) {
            *made = 0;
            return false;
        }
        *made = made.saturating_add(1);
        (self.current, self.stage) = (to, Stage::New);
        true
    }

    /// On to the next leg, of so many.
    fn proceed(&mut self, after: AfterStep, legs: usize) {
        self.stage = Stage::New;
        if usize::from(self.current) + 1 >= legs {
            self.phase = MissionPhase::Complete;
            return;
        }
        self.current += 1;
        match after {
            AfterStep::Proceed => {}
            AfterStep::Pause => self.phase = MissionPhase::Paused,
        }
    }

    /// What a step wants now; nothing once it is done.
    fn fly(&mut self, step: &MissionStep, situation: &MissionInput) -> Option<Directive> {
        match step {
            MissionStep::TakeOff(target) => {
                let top = target.height_m.unwrap_or(0.0).max(situation.position.z);
                let above = MissionTarget { height_m: Some(top), ..*target };
                self.take_off(target.height_m, situation).or_else(|| self.travel(&above, RADIUS_M, situation))
            }
            MissionStep::GoTo { target, hold_secs, radius_m } => {
                let radius_m = radius_m.unwrap_or(RADIUS_M).max(LEAST_RADIUS_M);
                self.take_off(None, situation)
                    .or_else(|| self.travel(target, radius_m, situation))
                    .or_else(|| self.time(*hold_secs, situation))
            }
            MissionStep::Loiter { target, time } => self
                .take_off(None, situation)
                .or_else(|| self.travel(target, RADIUS_M, situation))
                .or_else(|| match time {
                    LoiterTime::Secs(secs) => self.time(*secs, situation),
                    LoiterTime::UntilContinued => self.loiter(situation),
                }),
            MissionStep::Circle(circle) => {
                self.take_off(None, situation).or_else(|| self.circle(circle, situation))
            }
            MissionStep::Land(target) => self.land(target, situation),
            MissionStep::Return => (situation.motion != DroneMotion::OnGround).then_some(Directive::Return),
            MissionStep::ChangeSpeed(speed) => {
                self.speed = match speed {
                    MissionSpeed::Default => None,
                    MissionSpeed::Of(speed) => Some(*speed),
                };
                None
            }
            MissionStep::Delay { secs } => self.time(*secs, situation),
            MissionStep::Turn(turn) => self.turn(*turn, situation),
            MissionStep::Jump { .. } | MissionStep::Skip => None,
        }
    }

    /// Gets off the ground.
    fn take_off(&mut self, altitude_m: Option<f32>, situation: &MissionInput) -> Option<Directive> {
        match (situation.motion, self.stage) {
            (DroneMotion::OnGround, _) | (DroneMotion::Travelling, Stage::TakingOff) => {
                self.stage = Stage::TakingOff;
                Some(Directive::TakeOff { altitude_m })
            }
            (DroneMotion::Travelling | DroneMotion::Resting, _) => None,
        }
    }

    /// Gets to a place.
    fn travel(&mut self, target: &MissionTarget, radius_m: f32, situation: &MissionInput) -> Option<Directive> {
        let point = match self.stage {
            Stage::New | Stage::TakingOff => target.from(&situation.position),
            Stage::Travelling { point } => point,
            Stage::Staying { .. }
            | Stage::Turning { .. }
            | Stage::Circling { .. }
            | Stage::Loitering { .. }
            | Stage::Continued => return None,
        };
        if (situation.position - point).norm() <= radius_m {
            self.stage = Stage::Staying { at: Some(point), since_secs: situation.secs };
            return None;
        }
        self.stage = Stage::Travelling { point };
        Some(self.head_for(point))
    }

    /// Stays for some time, at the place that was travelled to if one was.
    fn time(&mut self, secs: f32, situation: &MissionInput) -> Option<Directive> {
        let (at, since_secs) = match self.stage {
            Stage::Staying { at, since_secs } => (at, since_secs),
            Stage::New
            | Stage::TakingOff
            | Stage::Travelling { .. }
            | Stage::Turning { .. }
            | Stage::Circling { .. }
            | Stage::Loitering { .. }
            | Stage::Continued => (None, situation.secs),
        };
        self.stage = Stage::Staying { at, since_secs };
        let waiting = situation.secs - since_secs < f64::from(secs);
        waiting.then(|| at.map_or(Directive::Wait, |point| self.head_for(point)))
    }

    /// Turns the nose, and waits for it; on the ground nothing turns.
    fn turn(&mut self, turn: MissionTurn, situation: &MissionInput) -> Option<Directive> {
        if situation.motion == DroneMotion::OnGround {
            return None;
        }
        let (heading, since_secs) = match (self.stage, turn) {
            (Stage::Turning { heading, since_secs }, _) => (heading, since_secs),
            (_, MissionTurn::To(heading)) => (heading, situation.secs),
            (_, MissionTurn::By(angle)) => (situation.heading + angle, situation.secs),
        };
        self.stage = Stage::Turning { heading, since_secs };
        let is_turned = angle_between(situation.heading, heading).abs() <= TURNED_RAD;
        (!is_turned && situation.secs - since_secs < TURN_SECS).then_some(Directive::Face { heading })
    }

    /// Goes to the nearest place of a circle, and around: toward a place that is always so far ahead.
    fn circle(&mut self, circle: &MissionCircle, situation: &MissionInput) -> Option<Directive> {
        let sign = match circle.sense {
            TurningSense::Clockwise => -1.0,
            TurningSense::CounterClockwise => 1.0,
        };
        let around = |center: Vector3<f32>, angle: f32| {
            let (sine, cosine) = libm::sincosf(angle);
            center + Vector3::new(cosine, sine, 0.0) * circle.radius_m
        };
        let bearing_from = |center: Vector3<f32>| {
            let from = situation.position - center;
            libm::atan2f(from.y, from.x)
        };
        if let Stage::New | Stage::TakingOff = self.stage {
            let center = circle.center.from(&situation.position);
            self.stage = Stage::Circling { center, bearing: bearing_from(center), swept: f32::NAN };
        }
        let Stage::Circling { center, bearing, swept } = self.stage else { return None };
        if swept.is_nan() {
            let entry = around(center, bearing);
            if (situation.position - entry).norm() > RADIUS_M {
                return Some(self.head_for(entry));
            }
        }
        let now = bearing_from(center);
        let swept = if swept.is_nan() { 0.0 } else { swept + sign * angle_between(bearing, now) };
        if swept >= circle.turns * core::f32::consts::TAU {
            return None;
        }
        self.stage = Stage::Circling { center, bearing: now, swept };
        let ahead = (AHEAD_M / circle.radius_m).min(AHEAD_RAD);
        Some(self.head_for(around(center, now + sign * ahead)))
    }

    fn loiter(&mut self, situation: &MissionInput) -> Option<Directive> {
        let at = match self.stage {
            Stage::Continued => return None,
            Stage::Loitering { at } | Stage::Staying { at: Some(at), .. } => at,
            Stage::New
            | Stage::TakingOff
            | Stage::Travelling { .. }
            | Stage::Turning { .. }
            | Stage::Circling { .. }
            | Stage::Staying { at: None, .. } => situation.position,
        };
        self.stage = Stage::Loitering { at };
        Some(self.head_for(at))
    }

    fn land(&mut self, target: &MissionTarget, situation: &MissionInput) -> Option<Directive> {
        if situation.motion == DroneMotion::OnGround {
            return None;
        }
        self.travel(target, RADIUS_M, situation).or(Some(Directive::Land))
    }

    fn head_for(&self, point: Vector3<f32>) -> Directive {
        Directive::HeadFor { point, speed: self.speed, heading: None }
    }
}

/// From one angle to another, the shorter way \[rad\].
fn angle_between(from: f32, to: f32) -> f32 {
    let (sine, cosine) = libm::sincosf(to - from);
    libm::atan2f(sine, cosine)
}

#[cfg(test)]
mod tests;
