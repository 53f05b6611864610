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
use kestrel_core::effectiveness::RotorEffectiveness;
use kestrel_core::pilot::{Pilot, StatePolicy};
use kestrel_core::policy_file::PolicyMetadata;
use kestrel_core::processor_in_the_loop::NO_POLICY;
use kestrel_core::scan::{ScanMap, Slab};
use kestrel_core::setpoint::Setpoint;
use kestrel_core::vehicle::State;
use nalgebra::Vector3;

/// Words of a `KestrelPilot`: one with the feature `recurrent` needs them all, and C does not know which it is linked with.
pub const KESTREL_PILOT_WORDS: usize = 468;

/// The same in this build: more than C has room for where the core has features that this library does not ask for, as when the
/// whole workspace is built.
const PILOT_WORDS: usize = {
    let needed = size_of::<Seat>().div_ceil(size_of::<u64>());
    if needed > KESTREL_PILOT_WORDS { needed } else { KESTREL_PILOT_WORDS }
};

/// A pilot takes place and flies.
pub const KESTREL_OK: i32 = 0;

/// There is no policy at the controls: none was taken, or the last one was refused.
pub const KESTREL_NO_POLICY: i32 = 100;

/// The position is not finite, or farther from the origin than a kilometre.
pub const KESTREL_POSITION: i32 = 101;

/// The attitude is not finite, or its norm is not one to within a tenth.
pub const KESTREL_ATTITUDE: i32 = 102;

/// The velocity is not finite, or faster than 100 m/s.
pub const KESTREL_VELOCITY: i32 = 103;

/// The body rates are not finite, or faster than 100 rad/s.
pub const KESTREL_BODY_RATES: i32 = 104;

/// The goal is not finite, or farther from the origin than a kilometre.
pub const KESTREL_GOAL: i32 = 105;

/// The policy's answer is not finite.
pub const KESTREL_ANSWER: i32 = 106;

/// The policy sees another number of measurements than it is shown, or one of them is not finite.
pub const KESTREL_UNMEASURED: i32 = 107;

/// The policy does not say what drone it was trained for, as files of before that was written.
pub const KESTREL_NO_AIRFRAME: i32 = 108;

/// Memory of a pilot. All zero, it is one without a policy.
#[repr(C)]
#[derive(Debug)]
pub struct KestrelPilot {
    memory: [u64; PILOT_WORDS],
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

/// The space between two parallel planes.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct KestrelSlab {
    /// Which of the map's normals.
    pub normal: u32,
    /// Where it begins along the normal in m, world.
    pub low: f32,
    /// Where it ends in m, world.
    pub high: f32,
}

/// What beams see of a room in which nothing moves, as `kestrel export --target crazyflie` writes it.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct KestrelMap {
    /// Nothing farther is seen, in m.
    pub limit: f32,
    /// With a scale s in m a beam reads (1 - d / limit) s / (s + d) for a distance d, with zero 1 - d / limit.
    pub near_scale: f32,
    /// Number of beams.
    pub beams: u32,
    /// For each beam: metres along it for a metre of height above the floor, zero if it meets no floor.
    pub per_descent: *const f32,
    /// Number of normals.
    pub normal_count: u32,
    /// Unit normals of slabs, world.
    pub normals: *const [f32; 3],
    /// For each normal, for each beam: metres along the beam for a metre along the normal.
    pub per_metre: *const f32,
    /// For each normal, a bit for each beam that goes along it, and for each that goes against it.
    pub sides: *const [u64; 2],
    /// Number of slabs.
    pub slab_count: u32,
    /// Slabs, body by body.
    pub slabs: *const KestrelSlab,
    /// Number of bodies.
    pub body_count: u32,
    /// How many slabs each body has.
    pub bodies: *const u32,
}

// SAFETY: nothing writes to a map.
unsafe impl Sync for KestrelMap {}

/// What lies in the memory of a pilot.
struct Seat {
    /// [`TAKEN`] while `pilot` is one.
    mark: u32,
    pilot: core::mem::MaybeUninit<Flyer>,
}

/// A pilot of a policy without a memory or, where this library has the feature `recurrent`, with one.
struct Flyer {
    pilot: Pilot<'static, StatePolicy<'static>>,
    /// What is known of the rotors, once somebody has asked to make up for them.
    effectiveness: Option<RotorEffectiveness>,
}

/// Unlikely to be found in memory that was never written.
const TAKEN: u32 = 0x4b65_7374;

const _: () = assert!(KESTREL_NO_POLICY == NO_POLICY, "a code means one thing");
const _: () =
    assert!(PILOT_WORDS == KESTREL_PILOT_WORDS || cfg!(not(target_os = "none")), "a pilot has room for its seat");
const _: () = assert!(size_of::<KestrelSlab>() == size_of::<Slab>(), "a slab of C is one of the core");
const _: () = assert!(align_of::<Seat>() <= align_of::<KestrelPilot>(), "a seat is aligned in its pilot");

impl KestrelPilot {
    /// A pilot without a policy.
    pub const fn new() -> Self {
        Self { memory: [0; PILOT_WORDS] }
    }

    fn seat(&mut self) -> &mut Seat {
        // SAFETY: large and aligned enough (asserted above), and every bit pattern is a seat: its pilot may be anything.
        unsafe { &mut *(&raw mut self.memory).cast::<Seat>() }
    }

    fn take(&mut self, policy: &'static [u8]) -> i32 {
        let seat = self.seat();
        seat.mark = 0;
        let flyer = match StatePolicy::parse(policy) {
            Ok(policy) => seat.pilot.write(Flyer { pilot: Pilot::with_runner(policy), effectiveness: None }),
            Err(error) => return i32::from(error.code()),
        };
        match flyer.pilot.self_test() {
            Ok(()) => {
                seat.mark = TAKEN;
                KESTREL_OK
            }
            Err(error) => i32::from(error.code()),
        }
    }

    fn pilot(&mut self) -> Option<&mut Pilot<'static, StatePolicy<'static>>> {
        self.flyer().map(|flyer| &mut flyer.pilot)
    }

    fn flyer(&mut self) -> Option<&mut Flyer> {
        let Seat { mark, pilot } = self.seat();
        // SAFETY: the mark is set behind a pilot, and taken away before it is replaced.
        (*mark == TAKEN).then(|| unsafe { pilot.assume_init_mut() })
    }

    fn tick(
        &mut self,
        state: &KestrelState,
        goal: &[f32; 4],
        measurements: &[f32],
        thrusts: &mut [f32; 4],
    ) -> i32 {
        *thrusts = [0.0; 4];
        let Some(flyer) = self.flyer() else { return KESTREL_NO_POLICY };
        let pilot = &mut flyer.pilot;
        let refusal = state.refusal(goal);
        if refusal != KESTREL_OK {
            return refusal;
        }
        let expected = pilot.metadata().observation.measured_len();
        if measurements.len() != expected || !measurements.iter().all(|value| value.is_finite()) {
            return KESTREL_UNMEASURED;
        }
        let KestrelState { position, attitude: [w, x, y, z], velocity, body_rates } = *state;
        let state = State {
            position: Vector3::from(position),
            world_from_body: Attitude { w, x, y, z },
            velocity: Vector3::from(velocity),
            body_rates: Vector3::from(body_rates),
            rotor_speeds: [0.0; 4],
        };
        let [gx, gy, gz, yaw] = *goal;
        let setpoint = Setpoint { yaw, ..Setpoint::at(Vector3::new(gx, gy, gz)) };
        let mut speeds = pilot.tick_towards(measurements, &state, &setpoint);
        if let Some(effectiveness) = &mut flyer.effectiveness {
            speeds = effectiveness.compensated(&speeds);
            effectiveness.learn(&state, &speeds, pilot.metadata().control_period_secs);
        }
        answer(pilot.metadata(), speeds, thrusts)
    }

    fn follow_rates(&mut self, body_rates: &[f32; 3], thrusts: &mut [f32; 4]) -> i32 {
        let Some(Flyer { pilot, effectiveness }) = self.flyer() else { return KESTREL_NO_POLICY };
        if !within(body_rates, BODY_RATES_LIMIT) {
            return KESTREL_BODY_RATES;
        }
        let Some(mut speeds) = pilot.follow_rates(&Vector3::from(*body_rates)) else { return KESTREL_OK };
        if let Some(effectiveness) = effectiveness {
            speeds = effectiveness.compensated(&speeds);
        }
        answer(pilot.metadata(), speeds, thrusts)
    }

    fn compensate_rotors(&mut self, on: bool) -> i32 {
        let Some(Flyer { pilot, effectiveness }) = self.flyer() else { return KESTREL_NO_POLICY };
        if !on {
            *effectiveness = None;
            return KESTREL_OK;
        }
        let PolicyMetadata { airframe: Some(airframe), action, .. } = pilot.metadata() else {
            return KESTREL_NO_AIRFRAME;
        };
        if effectiveness.is_none() {
            let (hover, limit) = (action.hover_speed_squared(), action.rotor_speed_limit());
            *effectiveness = Some(RotorEffectiveness::new(airframe, hover, limit));
        }
        KESTREL_OK
    }
}

impl KestrelState {
    /// Why nothing should fly by this state toward this goal; `KESTREL_OK` if nothing speaks against it.
    fn refusal(&self, goal: &[f32; 4]) -> i32 {
        let [w, x, y, z] = self.attitude;
        let norm_squared = w * w + x * x + y * y + z * z;
        let checks = [
            (within(&self.position, 1000.0), KESTREL_POSITION),
            ((0.81..=1.21).contains(&norm_squared), KESTREL_ATTITUDE),
            (within(&self.velocity, 100.0), KESTREL_VELOCITY),
            (within(&self.body_rates, BODY_RATES_LIMIT), KESTREL_BODY_RATES),
            (within(goal, 1000.0), KESTREL_GOAL),
        ];
        checks.iter().find(|(plausible, _)| !plausible).map_or(KESTREL_OK, |&(_, code)| code)
    }
}

/// Faster body rates are not believed \[rad/s\].
const BODY_RATES_LIMIT: f32 = 100.0;

/// Comparisons are false for NaN: what is not plausible includes what is not finite.
fn within(values: &[f32], limit: f32) -> bool {
    values.iter().all(|value| value.abs() <= limit)
}

/// Writes thrusts of rotor speeds \[rad/s\], in units of a quarter of the weight, unless one is not finite.
fn answer(metadata: &PolicyMetadata<'_>, speeds: [f32; 4], thrusts: &mut [f32; 4]) -> i32 {
    let per_hover_thrust = 1.0 / metadata.action.hover_speed_squared();
    let answer = speeds.map(|speed| speed * speed * per_hover_thrust);
    if !answer.iter().all(|thrust| thrust.is_finite()) {
        return KESTREL_ANSWER;
    }
    *thrusts = answer;
    KESTREL_OK
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
    if cfg!(not(test)) && PILOT_WORDS > KESTREL_PILOT_WORDS {
        return KESTREL_NO_POLICY;
    }
    // SAFETY: the caller's promise.
    pilot.take(unsafe { slice::from_raw_parts(policy, len) })
}

/// Forgets the past actions, as at the start of an episode: whenever something else has flown in between.
#[unsafe(no_mangle)]
pub extern "C" fn kestrel_reset(pilot: &mut KestrelPilot) {
    let Some(Flyer { pilot, effectiveness }) = pilot.flyer() else { return };
    pilot.reset();
    if let Some(effectiveness) = effectiveness {
        effectiveness.pause();
    }
}

/// One control period on the way to `goal`: x, y, z (m, world) and the heading there (rad, counter-clockwise from x; a
/// policy that sees no heading does not turn). Writes the thrust of each rotor in the order front right, back right, back
/// left, front left, in units of what each rotor carries while the drone hovers: a quarter of its weight. Returns
/// `KESTREL_OK`, or why `thrusts` are all zero and something else has to fly.
#[unsafe(no_mangle)]
pub extern "C" fn kestrel_tick(
    pilot: &mut KestrelPilot,
    state: &KestrelState,
    goal: &[f32; 4],
    thrusts: &mut [f32; 4],
) -> i32 {
    pilot.tick(state, goal, &[], thrusts)
}

/// As `kestrel_tick`, for a policy that sees what sensors measure: `count` values in the order and the scales of its
/// training. `KESTREL_UNMEASURED` if it sees more or fewer.
///
/// # Safety
/// `measurements` points to `count` values; it may be null if that is zero.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn kestrel_tick_measured(
    pilot: &mut KestrelPilot,
    state: &KestrelState,
    goal: &[f32; 4],
    measurements: *const f32,
    count: usize,
    thrusts: &mut [f32; 4],
) -> i32 {
    // SAFETY: the caller's promise.
    let measurements = if count == 0 { &[] } else { unsafe { slice::from_raw_parts(measurements, count) } };
    pilot.tick(state, goal, measurements, thrusts)
}

/// Writes what the beams of a lidar would read at a position (m, world) in the room of the map: as many values as the map has
/// beams, one at the drone, zero at the limit of the beams and beyond. The same bits as the simulator's.
///
/// # Safety
/// `map` is as the export wrote it; `beams` has room for the values.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn kestrel_scan(map: &KestrelMap, position: &[f32; 3], beams: *mut f32) {
    // SAFETY: the caller's promise; slabs are laid out as the core's.
    let (map, beams) = unsafe {
        let count = map.beams as usize;
        let view = ScanMap {
            limit: map.limit,
            near_scale: (map.near_scale > 0.0).then_some(map.near_scale),
            per_descent: slice::from_raw_parts(map.per_descent, count),
            normals: slice::from_raw_parts(map.normals, map.normal_count as usize),
            per_metre: slice::from_raw_parts(map.per_metre, map.normal_count as usize * count),
            sides: slice::from_raw_parts(map.sides, map.normal_count as usize),
            slabs: slice::from_raw_parts(map.slabs.cast(), map.slab_count as usize),
            bodies: slice::from_raw_parts(map.bodies, map.body_count as usize),
        };
        (view, slice::from_raw_parts_mut(beams, count))
    };
    map.nearness(position, beams);
}

/// The thrusts of the last tick at the body rates of this moment (rad/s, about the body's axes): for every sample of the
/// gyroscope between two ticks. A policy without a rate loop holds its thrusts, and leaves them as they are. Returns
/// `KESTREL_OK`, or why they are left.
#[unsafe(no_mangle)]
pub extern "C" fn kestrel_follow_rates(
    pilot: &mut KestrelPilot,
    body_rates: &[f32; 3],
    thrusts: &mut [f32; 4],
) -> i32 {
    pilot.follow_rates(body_rates, thrusts)
}

/// Whether to learn in flight what share of its thrust each rotor really makes (worn propellers, a load, a battery that sags),
/// and to drive weak ones harder. Off after a policy was taken; what was learned is forgotten when it is switched off, and stays
/// when it is switched on again and again. Returns `KESTREL_OK`, or why it stays off.
#[unsafe(no_mangle)]
pub extern "C" fn kestrel_compensate_rotors(pilot: &mut KestrelPilot, on: bool) -> i32 {
    pilot.compensate_rotors(on)
}

/// Writes what share of its thrust each rotor makes, as far as that was learned: ones where it is not.
#[unsafe(no_mangle)]
pub extern "C" fn kestrel_rotor_shares(pilot: &mut KestrelPilot, shares: &mut [f32; 4]) {
    let flyer = pilot.flyer();
    *shares = flyer.and_then(|flyer| flyer.effectiveness.as_ref()).map_or([1.0; 4], RotorEffectiveness::shares);
}

/// Time between two ticks in seconds; zero without a policy.
#[unsafe(no_mangle)]
pub extern "C" fn kestrel_control_period(pilot: &mut KestrelPilot) -> f32 {
    pilot.pilot().map_or(0.0, |pilot| pilot.metadata().control_period_secs)
}

/// Greatest thrust of a rotor that the policy knows, in units of a quarter of the weight; zero without a policy.
#[unsafe(no_mangle)]
pub extern "C" fn kestrel_greatest_thrust(pilot: &mut KestrelPilot) -> f32 {
    pilot.pilot().map_or(0.0, |pilot| {
        let action = &pilot.metadata().action;
        action.rotor_speed_limit() * action.rotor_speed_limit() / action.hover_speed_squared()
    })
}

#[cfg(test)]
mod tests;
