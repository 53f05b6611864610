//! A flight to a point in a given time, as the firmware's high-level commander plans it.

use nalgebra::Vector3;

/// How a plan runs through its time.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PlanProfile {
    /// Starts with the velocity that it finds and ends at rest, without a jump of velocity, acceleration or jerk at
    /// the end.
    Smooth,
    /// At the same velocity all the time.
    Linear,
}

/// What follows a plan.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ending {
    /// It hovers there.
    Hover,
    /// It sinks until the floor carries it.
    Land,
}

/// A straight way, unless there is a velocity in another direction to begin with.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TrajectoryPlan {
    /// Where it begins \[m, world\].
    pub start: Vector3<f32>,
    /// With which velocity it begins \[m/s, world\].
    pub start_velocity: Vector3<f32>,
    /// Where it ends \[m, world\].
    pub end: Vector3<f32>,
    /// Simulated time when it begins \[s\].
    pub start_secs: f64,
    /// How long it takes \[s\], above zero.
    pub duration_secs: f32,
    /// How it runs through its time.
    pub profile: PlanProfile,
    /// What follows.
    pub ending: Ending,
}

impl TrajectoryPlan {
    /// Position \[m\] and velocity \[m/s\] at a simulated time \[s\]; at rest at the end when it is over.
    pub fn at(&self, secs: f64) -> (Vector3<f32>, Vector3<f32>) {
        let share = ((secs - self.start_secs) / f64::from(self.duration_secs)) as f32;
        if share >= 1.0 {
            return (self.end, Vector3::zeros());
        }
        let share = share.max(0.0);
        let (way, duration_secs) = (self.end - self.start, self.duration_secs);
        match self.profile {
            PlanProfile::Linear => (self.start + way * share, way / duration_secs),
            PlanProfile::Smooth => {
                let (step, step_rate) = step(share);
                let (swing, swing_rate) = swing(share);
                let position = self.start + way * step + self.start_velocity * (swing * duration_secs);
                (position, way * (step_rate / duration_secs) + self.start_velocity * swing_rate)
            }
        }
    }

    /// Whether it is over at a simulated time \[s\].
    pub fn is_over(&self, secs: f64) -> bool {
        secs - self.start_secs >= f64::from(self.duration_secs)
    }
}

/// The polynomial of seventh degree from 0 to 1 whose first three derivatives vanish at both ends, and its first.
fn step(share: f32) -> (f32, f32) {
    let cube = share * share * share;
    let value = cube * share * (35.0 + share * (-84.0 + share * (70.0 - share * 20.0)));
    let rate = cube * (140.0 + share * (-420.0 + share * (420.0 - share * 140.0)));
    (value, rate)
}

/// The polynomial of seventh degree from 0 back to 0 that begins with slope 1 and whose other derivatives up to the
/// third vanish at both ends, and its first.
fn swing(share: f32) -> (f32, f32) {
    let cube = share * share * share;
    let value = share + cube * share * (-20.0 + share * (45.0 + share * (-36.0 + share * 10.0)));
    let rate = 1.0 + cube * (-80.0 + share * (225.0 + share * (-216.0 + share * 70.0)));
    (value, rate)
}

#[cfg(test)]
mod tests {
    use super::*;

    const PLAN: TrajectoryPlan = TrajectoryPlan {
        start: Vector3::new(1.0, 0.0, 0.5),
        start_velocity: Vector3::new(0.0, 0.4, 0.0),
        end: Vector3::new(3.0, 0.0, 1.5),
        start_secs: 10.0,
        duration_secs: 4.0,
        profile: PlanProfile::Smooth,
        ending: Ending::Hover,
    };

    #[test]
    fn it_begins_as_it_finds_and_ends_at_rest() {
        let (position, velocity) = PLAN.at(10.0);
        assert!((position - PLAN.start).norm() < 1e-6 && (velocity - PLAN.start_velocity).norm() < 1e-6);
        for secs in [13.999_999, 14.0, 99.0] {
            let (position, velocity) = PLAN.at(secs);
            assert!((position - PLAN.end).norm() < 1e-5 && velocity.norm() < 1e-4, "{position} {velocity}");
        }
        assert_eq!(PLAN.at(9.0), PLAN.at(10.0));
    }

    #[test]
    fn from_rest_it_is_halfway_at_half_time_and_fastest_there() {
        let plan = TrajectoryPlan { start_velocity: Vector3::zeros(), ..PLAN };
        let (position, velocity) = plan.at(12.0);
        assert!((position - (plan.start + plan.end) / 2.0).norm() < 1e-6);
        // 35/16 of the mean speed, the greatest slope of the polynomial.
        assert!((velocity - (plan.end - plan.start) / 4.0 * 35.0 / 16.0).norm() < 1e-5);
    }

    #[test]
    fn its_velocity_is_the_slope_of_its_position() {
        for profile in [PlanProfile::Smooth, PlanProfile::Linear] {
            let plan = TrajectoryPlan { profile, ..PLAN };
            for step in 1..40 {
                let secs = 10.0 + 0.1 * f64::from(step);
                let slope = (plan.at(secs + 0.01).0 - plan.at(secs - 0.01).0) / 0.02;
                assert!((slope - plan.at(secs).1).norm() < 2e-3, "{profile:?} at {secs}");
            }
        }
    }

    #[test]
    fn a_linear_plan_keeps_its_velocity() {
        let plan = TrajectoryPlan { profile: PlanProfile::Linear, ..PLAN };
        assert_eq!(plan.at(10.5).1, plan.at(13.5).1);
        assert!((plan.at(11.0).0 - Vector3::new(1.5, 0.0, 0.75)).norm() < 1e-6);
    }

    #[test]
    fn it_is_over_after_its_time() {
        assert!(!PLAN.is_over(13.99) && PLAN.is_over(14.0));
    }
}
