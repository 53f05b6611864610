//! The goal that the pilot sees: a point that moves toward its target at a limited speed.
//!
//! Policies are trained close to their goal. Handed a far set-point at once, one would tilt as far as it ever
//! learned to and arrive too fast; following a slow point it stays where it was trained.

use nalgebra::Vector3;

/// A point on its way, and where the nose shall point meanwhile.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MovingGoal {
    position: Vector3<f32>,
    course: Course,
    /// Counter-clockwise from the world's x axis, within half a turn \[rad\].
    heading: f32,
    /// Rate at which the heading changes \[rad/s\].
    turning: f32,
}

/// Where the nose shall point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Facing {
    /// Where it was told before.
    Kept,
    /// To a heading \[rad\], counter-clockwise from the world's x axis.
    Toward(f32),
    /// On and on at a rate \[rad/s\].
    Turning(f32),
}

/// Where a goal goes.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Course {
    /// To a point \[m, world\] at a speed \[m/s\], and there it rests.
    Toward { target: Vector3<f32>, speed: f32 },
    /// On and on at a velocity \[m/s, world\].
    Along { velocity: Vector3<f32> },
}

impl MovingGoal {
    /// A goal that rests at a point \[m, world\], with a heading \[rad\].
    pub fn at(position: Vector3<f32>, heading: f32) -> Self {
        Self { position, course: Course::Toward { target: position, speed: 0.0 }, heading, turning: 0.0 }
    }

    /// Where the nose shall point from now on.
    pub fn face(&mut self, facing: Facing) {
        match facing {
            Facing::Kept => {}
            Facing::Toward(heading) => (self.heading, self.turning) = (within_half_a_turn(heading), 0.0),
            Facing::Turning(rate) => self.turning = rate,
        }
    }

    /// Where the nose shall point \[rad\], counter-clockwise from the world's x axis.
    pub fn heading(&self) -> f32 {
        self.heading
    }

    /// Sets out from where it is toward `target` \[m, world\] at `speed` \[m/s\].
    pub fn head_for(&mut self, target: Vector3<f32>, speed: f32) {
        self.course = Course::Toward { target, speed };
    }

    /// Moves on from where it is at `velocity` \[m/s, world\].
    pub fn drift(&mut self, velocity: Vector3<f32>) {
        self.course = Course::Along { velocity };
    }

    /// Stays where it is.
    pub fn stop(&mut self) {
        *self = Self::at(self.position, self.heading);
    }

    /// Moves on for `secs`, unless that would take it farther than `leash_m` from the drone: a drone that cannot
    /// follow (wind, an obstacle, the floor) is waited for.
    pub fn advance(&mut self, drone: &Vector3<f32>, leash_m: f32, secs: f32) {
        self.heading = within_half_a_turn(self.heading + self.turning * secs);
        let next = self.next(secs);
        let distance = (next - drone).norm();
        if distance <= leash_m || distance < (self.position - drone).norm() {
            self.position = next;
        }
    }

    /// Where it wants to be after `secs`.
    fn next(&self, secs: f32) -> Vector3<f32> {
        match self.course {
            Course::Toward { target, speed } => {
                let (way, step_m) = (target - self.position, speed * secs);
                let distance = way.norm();
                if distance <= step_m { target } else { self.position + way * (step_m / distance) }
            }
            Course::Along { velocity } => self.position + velocity * secs,
        }
    }

    /// Where it is \[m, world\].
    pub fn position(&self) -> Vector3<f32> {
        self.position
    }

    /// Where it will come to rest \[m, world\]; where it is if it goes on and on.
    pub fn target(&self) -> Vector3<f32> {
        match self.course {
            Course::Toward { target, .. } => target,
            Course::Along { .. } => self.position,
        }
    }

    /// How it moves \[m/s, world\].
    pub fn velocity(&self) -> Vector3<f32> {
        match self.course {
            Course::Toward { target, speed } => {
                let way = target - self.position;
                let distance = way.norm();
                if distance > 0.0 { way * (speed / distance) } else { Vector3::zeros() }
            }
            Course::Along { velocity } => velocity,
        }
    }

    /// Whether it rests.
    pub fn arrived(&self) -> bool {
        match self.course {
            Course::Toward { target, .. } => self.position == target,
            Course::Along { velocity } => velocity == Vector3::zeros(),
        }
    }
}

/// The same direction, within ±π \[rad\].
fn within_half_a_turn(heading: f32) -> f32 {
    let turns = libm::roundf(heading / core::f32::consts::TAU);
    heading - turns * core::f32::consts::TAU
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_nose_goes_where_it_is_told_and_on_by_the_shorter_name() {
        let mut goal = MovingGoal::at(Vector3::zeros(), 0.5);
        goal.face(Facing::Kept);
        assert_eq!(goal.heading(), 0.5);
        goal.face(Facing::Toward(4.0));
        assert!((goal.heading() - (4.0 - core::f32::consts::TAU)).abs() < 1e-6);
        goal.face(Facing::Turning(-1.0));
        for _ in 0..100 {
            goal.advance(&Vector3::zeros(), 1.0, 0.01);
        }
        assert!((goal.heading() - 3.0).abs() < 1e-4);
        goal.stop();
        goal.advance(&Vector3::zeros(), 1.0, 1.0);
        assert!((goal.heading() - 3.0).abs() < 1e-4, "stopped, it keeps its heading");
    }

    #[test]
    fn it_moves_at_its_speed_and_stops_on_the_spot() {
        let mut goal = MovingGoal::at(Vector3::zeros(), 0.0);
        goal.head_for(Vector3::new(1.0, 0.0, 0.0), 0.5);
        for step in 1..=100 {
            goal.advance(&goal.position(), 1.0, 0.01);
            assert!((goal.position().x - 0.005 * step as f32).abs() < 1e-5);
        }
        for _ in 0..101 {
            goal.advance(&goal.position(), 1.0, 0.01);
        }
        assert!(goal.arrived());
        assert_eq!(goal.position(), Vector3::new(1.0, 0.0, 0.0));
    }

    #[test]
    fn it_waits_for_a_drone_that_stays_behind() {
        let mut goal = MovingGoal::at(Vector3::zeros(), 0.0);
        goal.head_for(Vector3::new(10.0, 0.0, 0.0), 1.0);
        for _ in 0..1000 {
            goal.advance(&Vector3::zeros(), 0.5, 0.01);
        }
        assert!((0.48..=0.5).contains(&goal.position().x));
    }

    #[test]
    fn it_may_come_back_to_a_drone_beyond_the_leash() {
        let mut goal = MovingGoal::at(Vector3::new(5.0, 0.0, 0.0), 0.0);
        goal.head_for(Vector3::zeros(), 1.0);
        goal.advance(&Vector3::zeros(), 0.5, 0.01);
        assert!(goal.position().x < 5.0);
    }

    #[test]
    fn stopped_it_rests_where_it_is() {
        let mut goal = MovingGoal::at(Vector3::zeros(), 0.0);
        goal.head_for(Vector3::new(1.0, 0.0, 0.0), 1.0);
        goal.advance(&Vector3::zeros(), 1.0, 0.25);
        goal.stop();
        goal.advance(&Vector3::zeros(), 1.0, 0.25);
        assert_eq!(goal.position(), Vector3::new(0.25, 0.0, 0.0));
    }

    #[test]
    fn drifting_it_goes_on_and_on_at_its_velocity() {
        let velocity = Vector3::new(0.3, -0.4, 0.1);
        let mut goal = MovingGoal::at(Vector3::zeros(), 0.0);
        goal.head_for(Vector3::new(-1.0, 0.0, 0.0), 1.0);
        goal.drift(velocity);
        for step in 1..=200 {
            goal.advance(&goal.position(), 1.0, 0.01);
            assert!((goal.position() - velocity * (0.01 * step as f32)).norm() < 1e-5);
        }
        assert!(!goal.arrived());
        goal.stop();
        assert!(goal.arrived());
    }

    #[test]
    fn drifting_it_stays_on_its_leash() {
        let mut goal = MovingGoal::at(Vector3::zeros(), 0.0);
        goal.drift(Vector3::new(0.0, 1.0, 0.0));
        for _ in 0..1000 {
            goal.advance(&Vector3::zeros(), 0.5, 0.01);
        }
        assert!((0.48..=0.5).contains(&goal.position().y));
    }
}
