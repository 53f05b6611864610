//! Drones of any size: an airframe for every episode, from palm-sized to half a metre.
//!
//! A size is drawn, and the mass that goes with it, by ratios; then everything else in numbers that drones of all sizes have in
//! common: thrust over weight, moments of inertia over mass and lever, the lever of the reaction torque over the arm, time
//! constants. What a known drone has beside (drag, flapping, damping) grows and shrinks with its size. The greatest rotor speed
//! stays that of the known one, because it is only a unit: another airframe that flies the same has another thrust per squared
//! speed.

use kestrel_core::airframe::{Airframe, DragCoefficients, FlightEffects, Layout, RotorOrder};

use crate::seed::Stream;

/// Airframes to draw from; bounds are least and greatest.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AirframeFamily {
    /// Take-off mass \[kg\].
    pub mass: [f32; 2],
    /// Distance of a rotor from the centre \[m\].
    pub arm: [f32; 2],
    /// Greatest thrust over weight.
    pub thrust_to_weight: [f32; 2],
    /// Time constant of a rotor that speeds up \[s\].
    pub rotor_lag: [f32; 2],
}

/// How far a mass may lie from the one that goes with a size, as a share of the way (in logarithms) from least to greatest.
const MASS_SPREAD: f32 = 0.15;
/// Moment of inertia about body x over mass and squared arm: 0.15 (Hummingbird) to 0.45 (Crazyflie 2.1).
const INERTIA: [f32; 2] = [0.12, 0.65];
/// Least and greatest angular acceleration about body x \[rad/s²\] of two rotors at full thrust and two at none: those of RAPTOR's
/// drones (Eschmann et al. 2025); a Crazyflie 2.1 has 416. A drone that the ratio above would make nimbler or clumsier has more
/// or less inertia.
const AGILITY: [f64; 2] = [40.0, 1_200.0];
/// Moment of inertia about y over that about x.
const PITCH_INERTIA: [f32; 2] = [0.75, 1.35];
/// That about z over the sum of the other two, which it is in a flat body.
const YAW_INERTIA: [f32; 2] = [0.5, 1.0];
/// Lever of the reaction torque over the arm: 0.023 (racer) to 0.63 (cf2x).
const REACTION: [f32; 2] = [0.02, 0.65];
/// Time constant of a rotor that slows down over that of one that speeds up.
const FALL: [f32; 2] = [0.8, 2.0];
/// Rotor drag over mass, as a share of the known drone's.
const DRAG: [f32; 2] = [0.1, 1.5];
/// Drag along the rotor axes over that across.
const AXIAL: [f32; 2] = [1.0, 1.4];
/// Flapping, damping, a rotor's inertia and body drag, as shares of the known drone's.
const EFFECTS: [f32; 2] = [0.1, 1.5];

impl AirframeFamily {
    /// One of them; what a `known` drone has beside is scaled to its size.
    pub(crate) fn draw(&self, known: &Airframe, stream: &mut Stream) -> Airframe {
        let size = stream.uniform();
        let arm = f64::from(at(self.arm, size));
        let share = size + stream.between(-MASS_SPREAD, MASS_SPREAD);
        let mass = f64::from(at(self.mass, share.clamp(0.0, 1.0)));
        let mut ratio = |bounds: [f32; 2]| f64::from(at(bounds, stream.uniform()));
        let thrust = ratio(self.thrust_to_weight) * mass * kestrel_core::airframe::GRAVITY / 4.0;
        let thrust_coefficient = thrust / (known.rotor_speed_limit * known.rotor_speed_limit);
        let turning = 2.0 * thrust * arm * core::f64::consts::FRAC_1_SQRT_2;
        let about_x = (ratio(INERTIA) * mass * arm * arm).clamp(turning / AGILITY[1], turning / AGILITY[0]);
        let about_y = about_x * ratio(PITCH_INERTIA);
        let inertia = [about_x, about_y, (about_x + about_y) * ratio(YAW_INERTIA)];
        let rotor_rise_secs = ratio(self.rotor_lag);
        let planar = known.drag_coefficients.planar / known.mass * mass * ratio(DRAG);
        let drone = Airframe {
            mass,
            inertia,
            layout: Layout::Cross { x: 1.0, y: 1.0 }.with_arm(arm),
            rotor_order: RotorOrder::Clockwise,
            arm,
            thrust_coefficient,
            torque_coefficient: thrust_coefficient * arm * ratio(REACTION),
            rotor_rise_secs,
            rotor_fall_secs: rotor_rise_secs * ratio(FALL),
            drag_coefficients: DragCoefficients { planar, axial: planar * ratio(AXIAL) },
            ..*known
        };
        Airframe { effects: scaled(known, &drone, ratio), ..drone }
    }
}

/// The known drone's effects, on one of another mass, inertia and arm: accelerations per speed and rate fall as drones grow.
fn scaled(known: &Airframe, drone: &Airframe, mut ratio: impl FnMut([f32; 2]) -> f64) -> FlightEffects {
    let (effects, smaller) = (&known.effects, known.arm / drone.arm);
    let turning = core::array::from_fn::<f64, 3, _>(|axis| drone.inertia[axis] / known.inertia[axis]);
    let damping = ratio(EFFECTS) * smaller;
    FlightEffects {
        flapping_moment: effects.flapping_moment * turning[0] * smaller * ratio(EFFECTS),
        rate_damping: core::array::from_fn(|axis| effects.rate_damping[axis] * turning[axis] * damping),
        rotor_inertia: effects.rotor_inertia * turning[2] * ratio(EFFECTS),
        body_drag: effects.body_drag * drone.mass / known.mass * smaller * ratio(EFFECTS),
        battery_sag: effects.battery_sag,
    }
}

/// Between two numbers by their ratio: the least at a share of 0, the greatest at 1.
fn at([least, greatest]: [f32; 2], share: f32) -> f32 {
    least * libm::powf(greatest / least, share)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::seed::{Purpose, Seed};
    use kestrel_core::airframe::CRAZYFLIE_2_1;

    const FAMILY: AirframeFamily = AirframeFamily {
        mass: [0.02, 2.5],
        arm: [0.03, 0.4],
        thrust_to_weight: [1.5, 5.0],
        rotor_lag: [0.01, 0.15],
    };

    #[test]
    fn drones_keep_to_their_bounds_and_reach_them() {
        let mut stream = Stream::new(Seed(3), 0, Purpose::Reset);
        let drones: Vec<Airframe> = (0..4_000).map(|_| FAMILY.draw(&CRAZYFLIE_2_1, &mut stream)).collect();
        let within = |what: &str, [least, greatest]: [f32; 2], of: &dyn Fn(&Airframe) -> f64| {
            let values = drones.iter().map(of);
            let (low, high) =
                values.fold((f64::MAX, 0.0_f64), |(low, high), value| (low.min(value), high.max(value)));
            let (least, greatest) = (f64::from(least), f64::from(greatest));
            assert!(low > least * 0.999 && low < least * 1.05, "{what}: {low}");
            assert!(high < greatest * 1.001 && high > greatest * 0.95, "{what}: {high}");
        };
        within("mass", FAMILY.mass, &|drone| drone.mass);
        within("arm", FAMILY.arm, &|drone| drone.arm);
        within("thrust", FAMILY.thrust_to_weight, &|drone| drone.thrust_limit() / drone.weight());
        within("lag", FAMILY.rotor_lag, &|drone| drone.rotor_rise_secs);
        // No body has more about z than about x and y together.
        assert!(drones.iter().all(|drone| drone.inertia[2] <= (drone.inertia[0] + drone.inertia[1]) * 1.000_001));
    }

    #[test]
    fn large_drones_are_heavy_and_feel_the_air_less() {
        let mut stream = Stream::new(Seed(4), 0, Purpose::Reset);
        let drones: Vec<Airframe> = (0..4_000).map(|_| FAMILY.draw(&CRAZYFLIE_2_1, &mut stream)).collect();
        let mean = |is_large: bool, of: &dyn Fn(&Airframe) -> f64| {
            let chosen: Vec<f64> = drones.iter().filter(|drone| (drone.arm > 0.1) == is_large).map(of).collect();
            chosen.iter().sum::<f64>() / chosen.len() as f64
        };
        assert!(mean(true, &|drone| drone.mass) > 5.0 * mean(false, &|drone| drone.mass));
        let flapping = |drone: &Airframe| drone.effects.flapping_moment / drone.inertia[0];
        assert!(mean(false, &flapping) > 2.0 * mean(true, &flapping));
    }
}
