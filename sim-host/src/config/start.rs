//! How episodes begin and what differs between them.

use kestrel_core::airframe::Airframe;
use nalgebra::Vector3;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::area::BoxConfig;
use super::error::ConfigError;
use super::field::{Field, Limits};
use super::geometry::{gap, surrounds};
use super::ways_of;
use crate::airframe_family::AirframeFamily;
use crate::scenario::{Aviary, FirstGoals, FreeSpace, PathStarts, Place, Randomisation, Start, StartPosition};
use crate::term::StartLimit;
use crate::termination::Termination;
use crate::trajectory::{Trajectories, TrajectoryShape};
use crate::world::{Cuboid, Floor};

/// Factors `1 ± fraction` stay well above zero.
const FRACTION: Limits = Limits::from(0.0, 0.9, "");
/// Shares of a number that few drones have in common.
const SHARE: Limits = Limits::from(0.05, 20.0, "");
const SPEED: Limits = Limits::from(0.0, 20.0, "m/s");

/// Start states: directions are random, headings and magnitudes uniform up to their limits.
#[derive(Clone, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct StartConfig {
    /// Where.
    pub position: StartPositionConfig,
    /// Greatest heading to either side of +x, for drones that have to look where they fly; 180, any, as a rule. Drones at
    /// places of their own have the place's, unless they start tilted.
    #[serde(default = "any_heading")]
    pub heading_limit_deg: f64,
    /// Greatest tilt.
    #[serde(default)]
    pub tilt_limit_deg: f64,
    /// Greatest speed.
    #[serde(default)]
    pub speed_limit_m_per_s: f64,
    /// Greatest angular velocity.
    #[serde(default)]
    pub body_rates_limit_rad_per_s: f64,
}

const fn any_heading() -> f64 {
    180.0
}

/// Where episodes begin.
#[derive(Clone, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum StartPositionConfig {
    /// At a random distance from the goal, in any direction.
    AroundGoal {
        /// Least distance.
        #[serde(default)]
        nearest_m: f64,
        /// Greatest distance.
        farthest_m: f64,
    },
    /// Anywhere in a box.
    Within(BoxConfig),
    /// Anywhere in a box that is far enough from everything that stands there. In training it shows a learner the whole
    /// way from its first episode on, also behind obstacles; judge the policy from the task's own start
    /// (`evaluation.start`).
    FreeWithin {
        /// Corner of the box with the smallest coordinates: `[x, y, z]`.
        low_m: [f64; 3],
        /// Corner with the greatest coordinates: `[x, y, z]`.
        high_m: [f64; 3],
        /// Least distance between the drone's centre and everything.
        clearance_m: f64,
    },
    /// On the shortest free way from a box to the goal, as `advance` knows it, or in the box: a reverse curriculum. Judge
    /// the policy from the box alone (`evaluation.start`).
    AlongWay {
        /// The task's own starts.
        from: BoxConfig,
        /// Greatest distance of a start from the way, along each axis.
        spread_m: f64,
        /// Least distance between the drone's centre and everything.
        clearance_m: f64,
        /// Share of the starts in the box.
        box_share: f64,
    },
    /// Always there, or nearby: one place for each drone.
    Exactly(Vec<StartPoseConfig>),
}

/// A place to start from.
#[derive(Clone, Copy, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct StartPoseConfig {
    /// Of the centre of mass: `[x, y, z]`.
    pub position_m: [f64; 3],
    /// Heading, counter-clockwise from +x; drones that start tilted have another, within `heading_limit_deg`.
    #[serde(default)]
    pub heading_deg: f64,
    /// Greatest distance of a start from there, in any direction.
    #[serde(default)]
    pub spread_m: f64,
}

/// Parameters drawn at each reset, as factors uniform in `1 ± fraction`, and a constant wind.
#[derive(Clone, Copy, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct RandomisationConfig {
    /// Of the mass.
    pub mass_fraction: f64,
    /// Of each moment of inertia.
    pub inertia_fraction: f64,
    /// Of the rotors' thrust.
    pub thrust_fraction: f64,
    /// Of the time constants of the rotors.
    pub rotor_lag_fraction: f64,
    /// Instead of `rotor_lag_fraction`: least and greatest share of the airframe's time constants.
    #[serde(skip_serializing_if = "is_full")]
    pub rotor_lag_share: [f64; 2],
    /// Of the reaction torque of the rotors, beside what the thrust changes of it.
    #[serde(skip_serializing_if = "is_zero")]
    pub torque_fraction: f64,
    /// Instead of `torque_fraction`: least and greatest share of the airframe's reaction torque. Measured drones and the
    /// models of other simulators lie apart by a factor of six.
    #[serde(skip_serializing_if = "is_full")]
    pub torque_share: [f64; 2],
    /// Of rotor drag, flapping moment, rotor inertia, body drag and battery sag, each by itself.
    #[serde(skip_serializing_if = "is_zero")]
    pub effects_fraction: f64,
    /// Least and greatest share of the airframe's rate damping, which flights tell least of.
    #[serde(skip_serializing_if = "is_full")]
    pub rate_damping_share: [f64; 2],
    /// Of the thrust of each motor by itself; for airframes with `effects`.
    #[serde(skip_serializing_if = "is_zero")]
    pub motor_fraction: f64,
    /// Least and greatest share of a commanded rotor speed that the battery reaches; for airframes with `effects`.
    #[serde(skip_serializing_if = "is_full")]
    pub battery_share: [f64; 2],
    /// Greatest speed of the wind, whose direction is random.
    pub wind_speed_m_per_s: f64,
    /// Least and greatest share of its thrust that one motor has, any of the four; for airframes with `effects`.
    #[serde(skip_serializing_if = "is_full")]
    pub weak_motor_share: [f64; 2],
    /// Another drone in every episode, of any size: the vehicle's airframe lends it only what grows and shrinks with the size.
    /// For `thrust_torques`; contacts keep the size of that airframe. What else is drawn is drawn around the drone.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub airframes: Option<AirframesConfig>,
}

/// Airframes to draw from, least and greatest; a drone's mass goes with its size, roughly.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize, Serialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct AirframesConfig {
    /// Take-off mass.
    pub mass_kg: [f64; 2],
    /// Distance of a rotor from the centre.
    pub arm_m: [f64; 2],
    /// Greatest thrust over weight.
    pub thrust_to_weight: [f64; 2],
    /// Time constant of a rotor that speeds up; one that slows down has 0.8 to 2 times that.
    pub rotor_lag_secs: [f64; 2],
}

impl Default for AirframesConfig {
    fn default() -> Self {
        Self {
            mass_kg: [0.02, 2.5],
            arm_m: [0.03, 0.4],
            thrust_to_weight: [1.5, 5.0],
            rotor_lag_secs: [0.01, 0.15],
        }
    }
}

impl AirframesConfig {
    fn check(&self, field: &Field<'_>) -> Result<AirframeFamily, ConfigError> {
        let bounds = |key: &str, bounds, limits: Limits| range(&field.at(key), bounds, &limits);
        Ok(AirframeFamily {
            mass: bounds("mass_kg", self.mass_kg, Limits::from(0.001, 1_000.0, "kg"))?,
            arm: bounds("arm_m", self.arm_m, Limits::from(0.005, 10.0, "m"))?,
            thrust_to_weight: bounds("thrust_to_weight", self.thrust_to_weight, Limits::from(1.1, 50.0, ""))?,
            rotor_lag: bounds("rotor_lag_secs", self.rotor_lag_secs, Limits::from(0.001, 10.0, "s"))?,
        })
    }
}

impl Default for RandomisationConfig {
    fn default() -> Self {
        Self {
            mass_fraction: 0.0,
            inertia_fraction: 0.0,
            thrust_fraction: 0.0,
            rotor_lag_fraction: 0.0,
            rotor_lag_share: [1.0; 2],
            torque_fraction: 0.0,
            torque_share: [1.0; 2],
            effects_fraction: 0.0,
            rate_damping_share: [1.0; 2],
            motor_fraction: 0.0,
            battery_share: [1.0; 2],
            wind_speed_m_per_s: 0.0,
            weak_motor_share: [1.0; 2],
            airframes: None,
        }
    }
}

#[expect(clippy::trivially_copy_pass_by_ref, reason = "the signature that serde asks for")]
pub(super) fn is_zero(fraction: &f64) -> bool {
    *fraction == 0.0
}

fn is_full(share: &[f64; 2]) -> bool {
    *share == [1.0; 2]
}

/// Two numbers within `limits`, the second not less than the first.
pub(super) fn range(field: &Field<'_>, [least, most]: [f64; 2], limits: &Limits) -> Result<[f32; 2], ConfigError> {
    let bounds = [field.at(0).number(least, limits)?, field.at(1).number(most, limits)?];
    if most < least {
        return Err(field.at(1).refuse(most, format!("{least} or more, the least before it")));
    }
    Ok(bounds)
}

/// The bounds of a factor, by `NAME_fraction` or by `NAME_share`.
fn one_of(field: &Field<'_>, name: &str, fraction: f64, share: [f64; 2]) -> Result<[f32; 2], ConfigError> {
    let fraction_key = format!("{name}_fraction");
    let share_field = field.at(format!("{name}_share"));
    let spread = field.at(&fraction_key).number(fraction, &FRACTION)?;
    let bounds = range(&share_field, share, &SHARE)?;
    match (spread > 0.0, is_full(&share)) {
        (true, true) => Ok([1.0 - spread, 1.0 + spread]),
        (false, _) => Ok(bounds),
        (true, false) => Err(share_field.reject(format!("{share:?} beside `{fraction_key}`"), "one of the two")),
    }
}

impl RandomisationConfig {
    /// The randomisation.
    ///
    /// # Errors
    /// When a number is out of range.
    pub fn check(&self, field: &Field<'_>) -> Result<Randomisation, ConfigError> {
        Ok(Randomisation {
            mass: field.at("mass_fraction").number(self.mass_fraction, &FRACTION)?,
            inertia: field.at("inertia_fraction").number(self.inertia_fraction, &FRACTION)?,
            thrust: field.at("thrust_fraction").number(self.thrust_fraction, &FRACTION)?,
            rotor_lag: one_of(field, "rotor_lag", self.rotor_lag_fraction, self.rotor_lag_share)?,
            torque: one_of(field, "torque", self.torque_fraction, self.torque_share)?,
            effects: field.at("effects_fraction").number(self.effects_fraction, &FRACTION)?,
            rate_damping: range(
                &field.at("rate_damping_share"),
                self.rate_damping_share,
                &Limits::from(0.0, 3.0, ""),
            )?,
            motor: field.at("motor_fraction").number(self.motor_fraction, &FRACTION)?,
            battery: range(&field.at("battery_share"), self.battery_share, &Limits::from(0.5, 1.2, ""))?,
            wind_speed: field.at("wind_speed_m_per_s").number(self.wind_speed_m_per_s, &SPEED)?,
            weak_motor: range(&field.at("weak_motor_share"), self.weak_motor_share, &Limits::from(0.0, 1.0, ""))?,
            airframes: self.airframes.map(|family| family.check(&field.at("airframes"))).transpose()?,
        })
    }
}

impl StartConfig {
    /// The start states, none of which ends its episode at once.
    ///
    /// # Errors
    /// When a number is out of range or a start would meet one of the `terminations`.
    pub fn check(
        &self,
        aviary: &Aviary,
        airframe: &Airframe,
        terminations: &[Termination],
        goals: &FirstGoals<'_>,
        field: &Field<'_>,
    ) -> Result<Start, ConfigError> {
        let half_turn = Limits::from(0.0, 180.0, "degrees");
        let heading = field.at("heading_limit_deg").real(self.heading_limit_deg, &half_turn)?;
        let tilt = field.at("tilt_limit_deg").number(self.tilt_limit_deg, &half_turn)?;
        let rates = Limits::from(0.0, 50.0, "rad/s");
        let start = Start {
            position: self.position.check(
                (aviary, airframe),
                terminations,
                goals.centres.len(),
                &field.at("position"),
            )?,
            heading_limit: heading.to_radians() as f32,
            tilt_limit: tilt.to_radians(),
            speed_limit: field.at("speed_limit_m_per_s").number(self.speed_limit_m_per_s, &SPEED)?,
            body_rates_limit: field
                .at("body_rates_limit_rad_per_s")
                .number(self.body_rates_limit_rad_per_s, &rates)?,
        };
        let region = Region { goals, position: &start.position };
        for termination in terminations {
            survives(&start, termination.start_limit(), &region, (aviary, airframe), field)?;
        }
        Ok(start)
    }
}

impl StartPositionConfig {
    fn check(
        &self,
        (aviary, airframe): (&Aviary, &Airframe),
        terminations: &[Termination],
        drones: usize,
        field: &Field<'_>,
    ) -> Result<StartPosition, ConfigError> {
        match self {
            Self::AroundGoal { nearest_m, farthest_m } => {
                let field = field.at("around_goal");
                let nearest = field.at("nearest_m").number(*nearest_m, &Limits::from(0.0, 100.0, "m"))?;
                let farthest =
                    field.at("farthest_m").number(*farthest_m, &Limits::from(*nearest_m, 100.0, "m"))?;
                Ok(StartPosition::AroundGoal { nearest_m: nearest, farthest_m: farthest })
            }
            Self::Within(region) => region.check(&field.at("within")).map(StartPosition::Within),
            Self::FreeWithin { low_m, high_m, clearance_m } => {
                let field = field.at("free_within");
                let region = BoxConfig { low_m: *low_m, high_m: *high_m }.check(&field)?;
                let clearance = field.at("clearance_m").number(*clearance_m, &Limits::above(0.0, 100.0, "m"))?;
                free_space(aviary, region, clearance, &field).map(StartPosition::FreeWithin)
            }
            Self::AlongWay { from, spread_m, clearance_m, box_share } => {
                let field = field.at("along_way");
                let region = from.check(&field.at("from"))?;
                let clearance = field.at("clearance_m").number(*clearance_m, &Limits::above(0.0, 100.0, "m"))?;
                let spread = field.at("spread_m").number(*spread_m, &Limits::from(0.0, 100.0, "m"))?;
                let share = field.at("box_share").number(*box_share, &Limits::from(0.0, 1.0, ""))?;
                let space = free_space(aviary, region, clearance, &field)?;
                let ways = ways_of(aviary, airframe, terminations);
                Ok(StartPosition::AlongWay(PathStarts::new(space, spread, share, ways)))
            }
            Self::Exactly(places) => {
                let field = field.at("exactly");
                if places.len() != drones {
                    return Err(field.refuse("", format!("a list of {drones}, one for each drone")));
                }
                let place = |(index, place): (usize, &StartPoseConfig)| place.check(&field.at(index));
                places.iter().enumerate().map(place).collect::<Result<_, _>>().map(StartPosition::Exactly)
            }
        }
    }
}

/// The part of the region that is free, which must have a point on a lattice of 32 points along each edge.
fn free_space(
    aviary: &Aviary,
    region: Cuboid,
    clearance_m: f32,
    field: &Field<'_>,
) -> Result<FreeSpace, ConfigError> {
    let mut obstacles = aviary.world.bounds();
    if aviary.world.floor == Floor::Solid {
        let far = 1.0e6;
        obstacles.push(Cuboid { low: Vector3::repeat(-far), high: Vector3::new(far, far, 0.0) });
    }
    let space = FreeSpace { region, clearance_m, obstacles, refuge: region.low };
    let number = |index: u32, axis: u32| (index >> (5 * axis) & 31) as f32 / 31.0;
    let point = |index: u32| {
        let Cuboid { low, high } = space.region;
        Vector3::from_fn(|axis, _| low[axis] + (high[axis] - low[axis]) * number(index, axis as u32))
    };
    let Some(refuge) = (0..1 << 15).map(point).find(|point| space.holds(point)) else {
        let found = format!("a box without a point {clearance_m} m from everything");
        return Err(field.reject(found, "one that is partly free"));
    };
    Ok(FreeSpace { refuge, ..space })
}

impl StartPoseConfig {
    fn check(&self, field: &Field<'_>) -> Result<Place, ConfigError> {
        let heading = Limits::from(-360.0, 360.0, "degrees");
        Ok(Place {
            position: field.at("position_m").place(self.position_m)?,
            heading: field.at("heading_deg").real(self.heading_deg, &heading)?.to_radians(),
            spread: field.at("spread_m").number(self.spread_m, &Limits::from(0.0, 100.0, "m"))?,
        })
    }
}

/// Refuses starts that a termination would end.
fn survives(
    start: &Start,
    limit: StartLimit,
    region: &Region<'_>,
    (aviary, airframe): (&Aviary, &Airframe),
    field: &Field<'_>,
) -> Result<(), ConfigError> {
    let position = field.at("position");
    match limit {
        StartLimit::Touching => region.clear(aviary, airframe.collision_radius as f32, &position),
        StartLimit::Outside(bounds) if !surrounds(&bounds, &region.hull()) => {
            Err(position.reject("starts out of bounds", "all of them inside `out_of_bounds` of the terminations"))
        }
        StartLimit::Tilt(limit) if start.tilt_limit >= limit => {
            let expected = format!("less than {} degrees, which ends the episode", limit.to_degrees().round());
            Err(field.at("tilt_limit_deg").refuse(start.tilt_limit.to_degrees(), expected))
        }
        StartLimit::Distance(limit) if region.farthest_from_goal() >= limit => {
            let found = format!("starts up to {:.2} m from the goal", region.farthest_from_goal());
            Err(position.reject(found, format!("less than {limit} m, where the episode ends")))
        }
        StartLimit::Speed(limit) if start.speed_limit >= limit => {
            let expected = format!("less than {limit} m/s, which ends the episode");
            Err(field.at("speed_limit_m_per_s").refuse(start.speed_limit, expected))
        }
        StartLimit::BodyRates(limit) if start.body_rates_limit >= limit => {
            let expected = format!("less than {limit} rad/s, which ends the episode");
            Err(field.at("body_rates_limit_rad_per_s").refuse(start.body_rates_limit, expected))
        }
        StartLimit::None
        | StartLimit::Outside(_)
        | StartLimit::Tilt(_)
        | StartLimit::Distance(_)
        | StartLimit::Speed(_)
        | StartLimit::BodyRates(_) => Ok(()),
    }
}

/// Where starts can be: balls around the drones' goals, a box or places.
struct Region<'a> {
    goals: &'a FirstGoals<'a>,
    position: &'a StartPosition,
}

impl Region<'_> {
    /// The smallest box around all starts.
    fn hull(&self) -> Cuboid {
        match self.position {
            StartPosition::AroundGoal { farthest_m, .. } => {
                let Cuboid { low, high } = hull_of(self.goals.centres.iter().copied());
                let curve = self.goals.curves.map_or(Vector3::zeros(), |curves| {
                    Vector3::new(curves.reach[1], curves.reach[1], curves.rise[1])
                });
                let around = curve.add_scalar(*farthest_m);
                Cuboid { low: low - around, high: high + around }
            }
            StartPosition::Within(region) | StartPosition::FreeWithin(FreeSpace { region, .. }) => *region,
            StartPosition::AlongWay(starts) => starts.space.region,
            StartPosition::Exactly(places) => {
                let corner = |place: &Place, side: f32| place.position.cast().add_scalar(side * place.spread);
                hull_of(places.iter().flat_map(|place| [corner(place, -1.0), corner(place, 1.0)]))
            }
        }
    }

    /// Greatest distance between a start and the goal of its drone \[m\].
    fn farthest_from_goal(&self) -> f32 {
        let distances: Vec<f32> = match self.position {
            StartPosition::AroundGoal { farthest_m, .. } => vec![*farthest_m],
            StartPosition::Within(Cuboid { low, high })
            | StartPosition::FreeWithin(FreeSpace { region: Cuboid { low, high }, .. })
            | StartPosition::AlongWay(PathStarts {
                space: FreeSpace { region: Cuboid { low, high }, .. }, ..
            }) => {
                self.goals.centres.iter().map(|goal| (goal - low).abs().sup(&(high - goal).abs()).norm()).collect()
            }
            StartPosition::Exactly(places) => {
                let pairs = places.iter().zip(&self.goals.centres);
                pairs.map(|(place, goal)| (place.position.cast() - goal).norm() + place.spread).collect()
            }
        };
        distances.into_iter().fold(0.0, f32::max)
    }

    /// Least distance between a start and the solid \[m\].
    fn gap_to(&self, solid: &Cuboid) -> f32 {
        let to_point = |point: Vector3<f32>| gap(&Cuboid { low: point, high: point }, solid);
        match self.position {
            StartPosition::AroundGoal { farthest_m, .. } => {
                let to_goal = |goal: &Vector3<f32>| match self.goals.curves {
                    None => to_point(*goal),
                    Some(curves) => gap_to_curves(goal, curves, solid),
                };
                self.goals.centres.iter().map(to_goal).fold(f32::INFINITY, f32::min) - farthest_m
            }
            StartPosition::Within(region) => gap(region, solid),
            StartPosition::AlongWay(starts) => gap(&starts.space.region, solid).min(starts.space.clearance_m),
            StartPosition::FreeWithin(space) => space.clearance_m,
            StartPosition::Exactly(places) => {
                let gaps = places.iter().map(|place| to_point(place.position.cast()) - place.spread);
                gaps.fold(f32::INFINITY, f32::min)
            }
        }
    }

    /// Refuses places of drones that touch each other.
    fn apart(&self, radius: f32, field: &Field<'_>) -> Result<(), ConfigError> {
        let StartPosition::Exactly(places) = self.position else { return Ok(()) };
        for (index, place) in places.iter().enumerate() {
            let distance =
                |other: &Place| (place.position - other.position).norm() as f32 - place.spread - other.spread;
            if let Some(other) = places[..index].iter().position(|other| distance(other) < 2.0 * radius) {
                let found = format!("a start {:.3} m from that of drone {other}", distance(&places[other]));
                let expected = format!("at least {} m between, twice the drone's radius", 2.0 * radius);
                return Err(field.at("exactly").at(index).reject(found, expected));
            }
        }
        Ok(())
    }

    /// Refuses starts nearer than `radius` \[m\] to the floor or a solid.
    fn clear(&self, aviary: &Aviary, radius: f32, field: &Field<'_>) -> Result<(), ConfigError> {
        if let StartPosition::FreeWithin(space) = self.position {
            return free_enough(space, radius, field);
        }
        if aviary.world.floor == Floor::Solid && self.hull().low.z < radius {
            let found = format!("starts as low as {:.3} m", self.hull().low.z);
            return Err(field.reject(found, format!("at least {radius} m above the floor, the drone's radius")));
        }
        match aviary.world.bounds().iter().find(|solid| self.gap_to(solid) < radius) {
            None => self.apart(radius, field),
            Some(solid) => {
                let found = format!("starts {:.3} m from {}", self.gap_to(solid).max(0.0), shown(solid));
                Err(field.reject(found, format!("at least {radius} m between, the drone's radius")))
            }
        }
    }
}

/// Refuses starts that may be nearer than `radius` \[m\] to something.
fn free_enough(space: &FreeSpace, radius: f32, field: &Field<'_>) -> Result<(), ConfigError> {
    if space.clearance_m >= radius {
        return Ok(());
    }
    let expected = format!("at least {radius} m, the drone's radius");
    Err(field.at("free_within").at("clearance_m").refuse(space.clearance_m, expected))
}

/// Least distance \[m\] between a solid and what curves about a centre may pass: a disc as high as they rise, or, where all
/// of them are circles, its outer ring.
fn gap_to_curves(centre: &Vector3<f32>, curves: &Trajectories, solid: &Cuboid) -> f32 {
    let circles = curves.shapes.iter().all(|shape| *shape == TrajectoryShape::Circle);
    let (inner, outer) = (if circles { curves.reach[0] } else { 0.0 }, curves.reach[1]);
    let (low, high) = (solid.low - centre, solid.high - centre);
    let nearest = low.sup(&-high).sup(&Vector3::zeros());
    let farthest = low.abs().sup(&high.abs());
    let across = (nearest.xy().norm() - outer).max(inner - farthest.xy().norm()).max(0.0);
    across.hypot((nearest.z - curves.rise[1]).max(0.0))
}

/// The smallest box around all points.
fn hull_of(points: impl Iterator<Item = Vector3<f32>> + Clone) -> Cuboid {
    let far = Vector3::repeat(f32::INFINITY);
    Cuboid {
        low: points.clone().fold(far, |low, point| low.inf(&point)),
        high: points.fold(-far, |high, point| high.sup(&point)),
    }
}

/// A box as messages show it.
fn shown(solid: &Cuboid) -> String {
    let Cuboid { low, high } = solid;
    format!("the solid x {}..{}, y {}..{}, z {}..{}", low.x, high.x, low.y, high.y, low.z, high.z)
}
