#![cfg_attr(target_os = "none", no_std)]
//! The core's pilot for C.
//!
//! `include/kestrel.h` is generated from this file (`BLESS=1 cargo test -p kestrel-crazyflie`). The caller owns all memory; there
//! is no heap, no global and, on a microcontroller, no panic: a library in which one could be reached does not link into a
//! firmware. `app` is an app for crazyflie-firmware around it, which `kestrel export --target crazyflie` completes.

#![expect(unsafe_code, reason = "C has pointers only")]

#[cfg(target_os = "none")]
#[path = "../../image/src/machine/panic.rs"]
mod panic;

use core::slice;

use kestrel_core::attitude::Attitude;
use kestrel_core::pilot::Pilot;
use kestrel_core::policy_file::PolicyFile;
use kestrel_core::processor_in_the_loop::NO_POLICY;
use kestrel_core::vehicle::State;
use nalgebra::Vector3;

/// Words of a `KestrelPilot`.
pub const KESTREL_PILOT_WORDS: usize = 560;

/// A pilot takes place and flies.
pub const KESTREL_OK: i32 = 0;

/// There is no policy at the controls: none was taken, or the last one was refused.
pub const KESTREL_NO_POLICY: i32 = 100;

/// A number of the state or the goal is not finite, or the policy's answer is not.
pub const KESTREL_NOT_FINITE: i32 = 101;

/// Memory of a pilot. All zero, it is one without a policy.
#[repr(C)]
#[derive(Debug)]
pub struct KestrelPilot {
    memory: [u64; KESTREL_PILOT_WORDS],
}

/// Where a drone is and how it moves.
///
/// The world's axes point forward (x), left (y) and up (z) at zero yaw; so do the body's.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct KestrelState {
    /// Centre of mass in m, world.
    pub position: [f32; 3],
    /// Attitude, unit quaternion w, x, y, z: from body to world.
    pub attitude: [f32; 4],
    /// Velocity in m/s, world.
    pub velocity: [f32; 3],
    /// Body rates in rad/s, about the body's axes.
    pub body_rates: [f32; 3],
}

/// What lies in the memory of a pilot.
struct Seat {
    /// [`TAKEN`] while `pilot` is one.
    mark: u32,
    pilot: core::mem::MaybeUninit<Pilot<'static>>,
}

/// Unlikely to be found in memory that nobody has written.
const TAKEN: u32 = 0x4b65_7374;

const _: () = assert!(KESTREL_NO_POLICY == NO_POLICY, "a code means one thing");
const _: () = assert!(size_of::<Seat>() <= size_of::<KestrelPilot>(), "a pilot has room for its seat");
const _: () = assert!(align_of::<Seat>() <= align_of::<KestrelPilot>(), "a seat is aligned in its pilot");

impl KestrelPilot {
    /// A pilot without a policy.
    pub const fn new() -> Self {
        Self { memory: [0; KESTREL_PILOT_WORDS] }
    }

    fn seat(&mut self) -> &mut Seat {
        // SAFETY: large and aligned enough (asserted above), and every bit pattern is a seat: its pilot may be anything.
        unsafe { &mut *(&raw mut self.memory).cast::<Seat>() }
    }

    fn take(&mut self, policy: &'static [u8]) -> i32 {
        let seat = self.seat();
        seat.mark = 0;
        let pilot = match PolicyFile::parse(policy) {
            Ok(policy) => seat.pilot.write(Pilot::new(policy)),
            Err(error) => return i32::from(error.code()),
        };
        match pilot.self_test() {
            Ok(()) => {
                seat.mark = TAKEN;
                KESTREL_OK
            }
            Err(error) => i32::from(error.code()),
        }
    }

    fn pilot(&mut self) -> Option<&mut Pilot<'static>> {
        let Seat { mark, pilot } = self.seat();
        // SAFETY: the mark is set behind a pilot, and taken away before it is replaced.
        (*mark == TAKEN).then(|| unsafe { pilot.assume_init_mut() })
    }

    fn tick(&mut self, state: &KestrelState, goal: &[f32; 3], thrusts: &mut [f32; 4]) -> i32 {
        *thrusts = [0.0; 4];
        let Some(pilot) = self.pilot() else { return KESTREL_NO_POLICY };
        let KestrelState { position, attitude, velocity, body_rates } = *state;
        let numbers = [&position[..], &attitude, &velocity, &body_rates, goal];
        if !numbers.into_iter().flatten().all(|number| number.is_finite()) {
            return KESTREL_NOT_FINITE;
        }
        let [w, x, y, z] = attitude;
        let state = State {
            position: Vector3::from(position),
            world_from_body: Attitude { w, x, y, z },
            velocity: Vector3::from(velocity),
            body_rates: Vector3::from(body_rates),
            rotor_speeds: [0.0; 4],
        };
        let speeds = pilot.tick(&state, &Vector3::from(*goal));
        let per_limit = 1.0 / pilot.policy().metadata().action.rotor_speed_limit();
        let shares = speeds.map(|speed| speed * per_limit);
        if !shares.iter().all(|share| share.is_finite()) {
            return KESTREL_NOT_FINITE;
        }
        *thrusts = shares.map(|share| (share * share).clamp(0.0, 1.0));
        KESTREL_OK
    }
}

impl Default for KestrelPilot {
    fn default() -> Self {
        Self::new()
    }
}

/// Takes a policy file and computes its golden vectors again. Returns `KESTREL_OK`, or why the policy is refused: the
/// number of the kind of damage (`PolicyError::code`); then `pilot` is without a policy.
///
/// # Safety
/// `pilot` points to a pilot; `policy` to `len` bytes, on a four-byte boundary, that stay as they are as long as it flies.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn kestrel_take_policy(pilot: &mut KestrelPilot, policy: *const u8, len: usize) -> i32 {
    // SAFETY: the caller's promise.
    pilot.take(unsafe { slice::from_raw_parts(policy, len) })
}

/// Forgets the past actions, as at the start of an episode: whenever something else has flown in between.
#[unsafe(no_mangle)]
pub extern "C" fn kestrel_reset(pilot: &mut KestrelPilot) {
    if let Some(pilot) = pilot.pilot() {
        pilot.reset();
    }
}

/// One control period on the way to `goal` (m, world): writes the thrust of each rotor as a share of the greatest, from 0 to
/// 1, in the order front right, back right, back left, front left. Returns `KESTREL_OK`, or why `thrusts` are all zero and
/// something else has to fly.
#[unsafe(no_mangle)]
pub extern "C" fn kestrel_tick(
    pilot: &mut KestrelPilot,
    state: &KestrelState,
    goal: &[f32; 3],
    thrusts: &mut [f32; 4],
) -> i32 {
    pilot.tick(state, goal, thrusts)
}

/// Time between two ticks in seconds; zero without a policy.
#[unsafe(no_mangle)]
pub extern "C" fn kestrel_control_period(pilot: &mut KestrelPilot) -> f32 {
    pilot.pilot().map_or(0.0, |pilot| pilot.policy().metadata().control_period_secs)
}

#[cfg(test)]
mod tests;
