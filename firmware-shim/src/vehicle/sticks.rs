//! Sticks of a remote control or a joystick: in the mode `Position` they set a velocity along the drone's heading and a turn.
//!
//! Ground stations send them as `MANUAL_CONTROL`, `ArduPilot`'s clients as `RC_CHANNELS_OVERRIDE` too. In the middle they hold the
//! drone; a drone on the ground takes off when it is told to climb by more than half. When they fall silent it holds, too.

use kestrel_onboard::fields::{i16_at, u16_at};
use kestrel_onboard::request::Address;
use nalgebra::Vector3;

use super::Vehicle;
use super::operator::{Operator, Purpose};
use crate::autopilot::{Command, Mode, Refusal, SPEED_LIMIT, SetPoint};
use crate::failsafe::FailsafeEvent;
use crate::frame::Frame;
use crate::goal::Facing;
use crate::policy_backend::PolicyBackend;
use crate::settings::FailsafeAction;

/// `MANUAL_CONTROL` and `RC_CHANNELS_OVERRIDE`.
const MANUAL_CONTROL: u32 = 69;
const CHANNELS_OVERRIDE: u32 = 70;

/// Nearer to the middle than this a stick is in the middle.
const DEAD_BAND: f32 = 0.05;

/// Of a drone on the ground.
const TAKE_OFF: f32 = 0.5;

/// Of a stick at its end \[rad/s\].
const TURNING: f32 = 1.5;

/// Pulses \[µs\] of a channel in the middle, and from there to an end.
const MIDDLE_US: u16 = 1500;
const TRAVEL_US: f32 = 500.0;

/// Each from -1 to 1.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Sticks {
    forward: f32,
    right: f32,
    up: f32,
    clockwise: f32,
}

impl Sticks {
    /// Of the axes of `MANUAL_CONTROL`: thousandths, the throttle from 0 to 1000; an axis without a value is in the middle.
    fn of_axes(fields: &[u8; 11]) -> Self {
        let axis = |at, middle: i16| match i16_at(fields, at) {
            i16::MAX => 0.0,
            value => f32::from(value.saturating_sub(middle)) / f32::from(1000 - middle),
        };
        Self { forward: axis(0, 0), right: axis(2, 0), up: axis(4, 500), clockwise: axis(6, 0) }.clean()
    }

    /// Of the pulses of `RC_CHANNELS_OVERRIDE`: roll, pitch (greater is backward), throttle, yaw; none if all are given back.
    fn of_channels(fields: &[u8; 18]) -> Option<Self> {
        let pulses: [u16; 4] = core::array::from_fn(|channel| u16_at(fields, 2 * channel));
        let free = |pulse: &u16| [0, u16::MAX].contains(pulse);
        if pulses.iter().all(free) {
            return None;
        }
        let [right, backward, up, clockwise] = pulses.map(|pulse| {
            let pulse = if free(&pulse) { MIDDLE_US } else { pulse };
            (f32::from(pulse) - f32::from(MIDDLE_US)) / TRAVEL_US
        });
        Some(Self { forward: -backward, right, up, clockwise }.clean())
    }

    fn clean(self) -> Self {
        let clean = |value: f32| if value.abs() < DEAD_BAND { 0.0 } else { value.clamp(-1.0, 1.0) };
        let Self { forward, right, up, clockwise } = self;
        Self { forward: clean(forward), right: clean(right), up: clean(up), clockwise: clean(clockwise) }
    }
}

impl<P: PolicyBackend> Vehicle<P> {
    /// Whether a frame has sticks; then they are obeyed.
    pub(super) fn handle_sticks(&mut self, frame: &Frame) -> bool {
        let (sticks, system) = match frame.message_id {
            MANUAL_CONTROL => (Some(Sticks::of_axes(&frame.fields())), frame.fields::<11>()[10]),
            CHANNELS_OVERRIDE => (Sticks::of_channels(&frame.fields()), frame.fields::<18>()[16]),
            _ => return false,
        };
        if let Some(sticks) = sticks
            && self.controller.is_meant(Address { system, component: 0 })
        {
            let outcome = self.steer(sticks, Operator::System(frame.system));
            self.send_status_text(outcome.err().map(Refusal::text));
        }
        true
    }

    /// Flies by sticks.
    fn steer(&mut self, sticks: Sticks, operator: Operator) -> Result<(), Refusal> {
        self.permit(operator, Purpose::Fly)?;
        if !self.by_sticks {
            return Err(Refusal::NoSticks);
        }
        let set_point = SetPoint::Velocity(self.stick_velocity(&sticks));
        match self.mode() {
            Mode::Armed | Mode::Landed if sticks.up < TAKE_OFF => return Ok(()),
            Mode::Armed | Mode::Landed | Mode::Holding => {
                // Waits for the offboard mode, and opens it.
                let _waits = self.controller.autopilot_mut().set_point(set_point);
                self.controller.autopilot_mut().command(Command::Offboard)?;
            }
            Mode::Offboard => {}
            Mode::Disarmed | Mode::TakingOff | Mode::Guided | Mode::Returning | Mode::Landing => return Ok(()),
        }
        let autopilot = self.controller.autopilot_mut();
        autopilot.set_point(set_point)?;
        autopilot.face(Facing::Turning(-TURNING * sticks.clockwise))?;
        self.note_done(operator, Purpose::Fly);
        Ok(())
    }

    /// Along the heading and up \[m/s, world\].
    fn stick_velocity(&self, sticks: &Sticks) -> Vector3<f32> {
        let settings = self.autopilot().settings();
        let (sine, cosine) = libm::sincosf(self.autopilot().whereabouts().heading);
        let [forward, right] = [sticks.forward, sticks.right].map(|share| share * settings.cruise_speed);
        let up = sticks.up * if sticks.up > 0.0 { settings.climb_speed } else { settings.descent_speed };
        let velocity = Vector3::new(cosine * forward + sine * right, sine * forward - cosine * right, up);
        velocity * (SPEED_LIMIT / velocity.norm().max(SPEED_LIMIT)).min(1.0)
    }

    /// What has gone wrong takes the sticks away, until the mode is chosen anew; their own silence does not.
    pub(super) fn tend_sticks(&mut self) {
        let settings = *self.autopilot().settings();
        let acts = |event: &FailsafeEvent| {
            *event != FailsafeEvent::OffboardLost && event.reaction(&settings).action > FailsafeAction::Warn
        };
        if self.autopilot().events().iter().any(acts) {
            self.by_sticks = false;
        }
    }
}
