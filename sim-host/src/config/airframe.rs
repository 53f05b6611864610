//! The drone: one of the known airframes, or a user's own in numbers.

use std::fmt;
use std::path::Path;

use kestrel_core::airframe::{
    Airframe, BOLT_5_INCH, CF2P, CF2X, CRAZYFLIE_2_1, CRAZYFLIE_2_1_BRUSHLESS, CRAZYFLIE_2_1_PLUS,
    CRAZYFLIE_2_1_THRUST_UPGRADE, Downwash, DragCoefficients, FlightEffects, GRAVITY, HUMMINGBIRD, Layout, RACER,
    RADIANS_PER_SECOND_PER_RPM, RotorOrder, X500,
};
use schemars::{JsonSchema, Schema, SchemaGenerator, json_schema};
use serde::de::value::{MapAccessDeserializer, StrDeserializer};
use serde::de::{Deserializer, MapAccess, Visitor};
use serde::{Deserialize, Serialize, Serializer};

use super::Document;
use super::error::ConfigError;
use super::field::{Field, Limits};

/// Share of the full thrust that hovering may need, so that there is some left to steer with.
pub(super) const HOVER_SHARE: f64 = 0.9;

/// Longest lever of a reaction torque \[m\]: propellers have a few centimetres.
const TORQUE_LEVER_LIMIT: f64 = 1.0;

/// \[N s²/rad²\] of \[N/RPM²\], and of torques likewise, when multiplied.
const PER_RPM_SQUARED: f64 = RADIANS_PER_SECOND_PER_RPM * RADIANS_PER_SECOND_PER_RPM;

/// A drone, by name or in numbers.
#[derive(Clone, Debug, PartialEq)]
pub enum AirframeConfig {
    /// A known one.
    Known(KnownAirframe),
    /// Another one, in numbers.
    Custom(Box<AirframeNumbers>),
}

/// The known drones.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum KnownAirframe {
    /// Crazyflie 2.x, rotors diagonal to the direction of flight, as gym-pybullet-drones has it.
    #[default]
    Cf2x,
    /// Crazyflie 2.1, identified from real flights.
    #[serde(rename = "crazyflie_2_1")]
    Crazyflie21,
    /// Crazyflie 2.1 Brushless with deck and markers, identified from real flights.
    #[serde(rename = "crazyflie_2_1_brushless")]
    Crazyflie21Brushless,
    /// Crazyflie 2.1+.
    #[serde(rename = "crazyflie_2_1_plus")]
    Crazyflie21Plus,
    /// Crazyflie 2.1 with the thrust upgrade kit.
    #[serde(rename = "crazyflie_2_1_thrust_upgrade")]
    Crazyflie21ThrustUpgrade,
    /// 5-inch quadrotor for the Crazyflie Bolt.
    #[serde(rename = "bolt_5_inch")]
    Bolt5Inch,
    /// Holybro X500 v2.
    X500,
    /// Crazyflie 2.x, one rotor ahead.
    Cf2p,
    /// `AscTec` Hummingbird.
    Hb,
    /// Racing quadrotor.
    Racer,
}

/// Whose numbering of the rotors a known drone has.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum RotorOrderConfig {
    /// gym-pybullet-drones since August 2025.
    Upstream,
    /// The thesis's fork, and gym-pybullet-drones before: the Crazyflie's rotors counter-clockwise too.
    Fork,
}

/// A quadrotor in numbers; body axes: x forward, y left, z up.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct AirframeNumbers {
    /// Take-off mass.
    pub mass_kg: f64,
    /// Principal moments of inertia about body x, y, z.
    pub inertia_kg_m2: [f64; 3],
    /// Where the rotors are.
    pub layout: LayoutConfig,
    /// Which way round the rotors are numbered, seen from above.
    #[serde(default)]
    pub rotor_order: RotorNumbering,
    /// Nominal distance of a rotor from the centre, by which the reference's controllers turn the drone; by default
    /// the distance that the layout says.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub arm_m: Option<f64>,
    /// Thrust of one rotor per squared speed \[N/RPM²\].
    pub thrust_n_per_rpm2: f64,
    /// Reaction torque of one rotor per squared speed \[N m/RPM²\]; negative where the first and third rotor turn
    /// clockwise.
    pub torque_nm_per_rpm2: f64,
    /// Greatest speed of a rotor.
    pub rotor_speed_limit_rpm: f64,
    /// First-order time constant of a rotor that speeds up; by default the Crazyflie's, stretched by the ratio of the
    /// hover speeds.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rotor_rise_secs: Option<f64>,
    /// First-order time constant of a rotor that slows down; default as above.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rotor_fall_secs: Option<f64>,
    /// Rotor drag across body z: force per speed and summed rotor speed \[N/(m/s) per rad/s\].
    #[serde(default)]
    pub drag_planar_kg_per_rad: f64,
    /// Rotor drag along body z.
    #[serde(default)]
    pub drag_axial_kg_per_rad: f64,
    /// Propeller radius.
    pub propeller_radius_m: f64,
    /// Strength of the ground effect.
    #[serde(default)]
    pub ground_effect_coefficient: f64,
    /// The wind that the drone makes below itself.
    #[serde(default)]
    pub downwash: DownwashConfig,
    /// The cylinder with which it touches things.
    pub collision: CollisionConfig,
    /// Speed that the maker states; the reference's velocity action is a share of it.
    #[serde(default = "nominal_speed_km_per_h")]
    pub nominal_speed_km_per_h: f64,
    /// What real flights show beside thrust and rotor drag; nothing by default.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub effects: Option<EffectsConfig>,
}

/// Forces and moments of a real drone, as `kestrel identify` finds them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Deserialize, Serialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct EffectsConfig {
    /// Moment about body x and y per air speed across the rotors and summed rotor speed \[N m/(m/s) per rad/s\]: blade
    /// flapping, and drag above the centre of mass.
    pub flapping_moment_n_s2_per_rad: f64,
    /// Moment about body x, y, z against a body rate.
    pub rate_damping_n_m_s_per_rad: [f64; 3],
    /// Inertia of a rotor, with all that turns with it.
    pub rotor_inertia_kg_m2: f64,
    /// Drag of the body per squared air speed.
    pub body_drag_n_s2_per_m2: f64,
    /// Share of a commanded rotor speed that the battery's resistance costs at full thrust.
    pub battery_sag: f64,
}

/// Rotors in the body plane.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum LayoutConfig {
    /// Diagonal to the direction of flight.
    Cross {
        /// Distance of every rotor from the body y axis.
        x_m: f64,
        /// Distance of every rotor from the body x axis.
        y_m: f64,
    },
    /// One ahead.
    Plus {
        /// Distance of every rotor from the centre.
        arm_m: f64,
    },
}

/// From the front right rotor of a cross, or the front rotor of a plus …
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum RotorNumbering {
    /// … to the rear right or right one, as on the Crazyflie.
    #[default]
    Clockwise,
    /// The mirror image: from the front left or front one to the rear left or left one.
    CounterClockwise,
}

/// A Gaussian jet whose strength falls with the square of the distance; none by default.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct DownwashConfig {
    /// Force at a distance of a quarter propeller radius.
    pub strength_n: f64,
    /// Growth of the jet's width with depth.
    pub width_slope: f64,
    /// Width of the jet extrapolated to the rotor plane.
    pub width_offset_m: f64,
}

/// An upright cylinder.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct CollisionConfig {
    /// Radius.
    pub radius_m: f64,
    /// Height.
    pub height_m: f64,
    /// Height of its centre above the centre of mass.
    #[serde(default)]
    pub offset_m: f64,
}

/// The airframe in a file of its own, YAML or URDF.
///
/// # Errors
/// What is wrong in it, with its line.
pub fn read_airframe(path: &Path) -> Result<Airframe, ConfigError> {
    let document = Document::read(path)?;
    document.decode::<AirframeNumbers>()?.check(&document.root())
}

/// The Crazyflie's.
fn nominal_speed_km_per_h() -> f64 {
    30.0
}

impl Default for DownwashConfig {
    fn default() -> Self {
        Self { strength_n: 0.0, width_slope: 0.0, width_offset_m: 1.0 }
    }
}

impl Default for AirframeConfig {
    fn default() -> Self {
        Self::Known(KnownAirframe::default())
    }
}

impl KnownAirframe {
    /// Its constants.
    pub const fn airframe(self) -> Airframe {
        match self {
            Self::Cf2x => CF2X,
            Self::Crazyflie21 => CRAZYFLIE_2_1,
            Self::Crazyflie21Brushless => CRAZYFLIE_2_1_BRUSHLESS,
            Self::Crazyflie21Plus => CRAZYFLIE_2_1_PLUS,
            Self::Crazyflie21ThrustUpgrade => CRAZYFLIE_2_1_THRUST_UPGRADE,
            Self::Bolt5Inch => BOLT_5_INCH,
            Self::X500 => X500,
            Self::Cf2p => CF2P,
            Self::Hb => HUMMINGBIRD,
            Self::Racer => RACER,
        }
    }
}

impl AirframeConfig {
    /// The airframe, its rotors in the given order if there is one.
    ///
    /// # Errors
    /// When a number is out of range, or `order` is given for a drone that has its own.
    pub fn check(
        &self,
        order: Option<RotorOrderConfig>,
        field: &Field<'_>,
        order_field: &Field<'_>,
    ) -> Result<Airframe, ConfigError> {
        match (self, order) {
            (Self::Known(known), None) => Ok(known.airframe()),
            (Self::Known(KnownAirframe::Cf2x), Some(RotorOrderConfig::Upstream)) => Ok(CF2X),
            (Self::Known(known), Some(RotorOrderConfig::Upstream | RotorOrderConfig::Fork)) => {
                Ok(known.airframe().numbered(RotorOrder::CounterClockwise))
            }
            (Self::Custom(numbers), None) => numbers.check(field),
            (Self::Custom(_), Some(_)) => {
                Err(order_field
                    .reject("an order beside an airframe in numbers", "`rotor_order` among its numbers"))
            }
        }
    }
}

impl AirframeNumbers {
    /// The airframe.
    ///
    /// # Errors
    /// When a number is out of range, or they describe no drone that can fly.
    pub fn check(&self, field: &Field<'_>) -> Result<Airframe, ConfigError> {
        let mass = within(&field.at("mass_kg"), self.mass_kg, &Limits::from(0.001, 100.0, "kg"))?;
        let thrust =
            within(&field.at("thrust_n_per_rpm2"), self.thrust_n_per_rpm2, &Limits::above(0.0, 1e-3, "N/RPM²"))?;
        let limit = within(
            &field.at("rotor_speed_limit_rpm"),
            self.rotor_speed_limit_rpm,
            &Limits::from(100.0, 1e6, "RPM"),
        )?;
        let hover_rpm = (mass * GRAVITY / (4.0 * thrust)).sqrt();
        if hover_rpm * hover_rpm > HOVER_SHARE * limit * limit {
            let expected = format!("{:.0} RPM or more, to carry {mass} kg", hover_rpm / HOVER_SHARE.sqrt());
            return Err(field.at("rotor_speed_limit_rpm").refuse(limit, expected));
        }
        let layout = self.layout.check(&field.at("layout"))?;
        // How the constants of the Crazyflie stretch to a drone whose rotors turn slower.
        let stretch = CF2X.hover_rotor_speed() / (hover_rpm * RADIANS_PER_SECOND_PER_RPM);
        let radius_limits = Limits::from(0.0, 1.0, "m");
        let speed_limits = Limits::above(0.0, 1000.0, "km/h");
        let speed = within(&field.at("nominal_speed_km_per_h"), self.nominal_speed_km_per_h, &speed_limits)?;
        let (collision_radius, collision_height, collision_offset) =
            self.collision.check(&field.at("collision"))?;
        Ok(Airframe {
            mass,
            inertia: inertia(self.inertia_kg_m2, &field.at("inertia_kg_m2"))?,
            layout,
            rotor_order: self.rotor_order.order(),
            arm: self.arm(&layout, &field.at("arm_m"))?,
            thrust_coefficient: thrust / PER_RPM_SQUARED,
            torque_coefficient: self.torque(&field.at("torque_nm_per_rpm2"))? / PER_RPM_SQUARED,
            rotor_speed_limit: limit * RADIANS_PER_SECOND_PER_RPM,
            rotor_rise_secs: lag(
                &field.at("rotor_rise_secs"),
                self.rotor_rise_secs,
                stretch * CF2X.rotor_rise_secs,
            )?,
            rotor_fall_secs: lag(
                &field.at("rotor_fall_secs"),
                self.rotor_fall_secs,
                stretch * CF2X.rotor_fall_secs,
            )?,
            drag_coefficients: self.drag(field)?,
            propeller_radius: within(&field.at("propeller_radius_m"), self.propeller_radius_m, &radius_limits)?,
            ground_effect_coefficient: within(
                &field.at("ground_effect_coefficient"),
                self.ground_effect_coefficient,
                &Limits::from(0.0, 1000.0, ""),
            )?,
            downwash: self.downwash.check(&field.at("downwash"))?,
            collision_radius,
            collision_height,
            collision_offset,
            nominal_speed: speed / 3.6,
            effects: self.effects.unwrap_or_default().check(&field.at("effects"))?,
        })
    }

    fn arm(&self, layout: &Layout, field: &Field<'_>) -> Result<f64, ConfigError> {
        match (self.arm_m, layout) {
            (Some(arm), Layout::Cross { .. } | Layout::Plus { .. }) => within(field, arm, &LEVER_LIMITS),
            (None, Layout::Plus { arm }) => Ok(*arm),
            (None, Layout::Cross { x, y }) => Ok(x.hypot(*y)),
        }
    }

    fn torque(&self, field: &Field<'_>) -> Result<f64, ConfigError> {
        let most = TORQUE_LEVER_LIMIT * self.thrust_n_per_rpm2;
        let torque = within(field, self.torque_nm_per_rpm2, &Limits::from(-most, most, "N m/RPM²"))?;
        if torque == 0.0 {
            Err(field.refuse(torque, "not zero: reaction torques turn the nose"))
        } else {
            Ok(torque)
        }
    }

    fn drag(&self, field: &Field<'_>) -> Result<DragCoefficients, ConfigError> {
        let limits = Limits::from(0.0, 1.0, "kg/rad");
        Ok(DragCoefficients {
            planar: within(&field.at("drag_planar_kg_per_rad"), self.drag_planar_kg_per_rad, &limits)?,
            axial: within(&field.at("drag_axial_kg_per_rad"), self.drag_axial_kg_per_rad, &limits)?,
        })
    }
}

impl EffectsConfig {
    fn check(&self, field: &Field<'_>) -> Result<FlightEffects, ConfigError> {
        let damping = field.at("rate_damping_n_m_s_per_rad");
        let number = |key: &str, value: f64, limits| within(&field.at(key), value, &limits);
        for (axis, value) in self.rate_damping_n_m_s_per_rad.into_iter().enumerate() {
            within(&damping.at(axis), value, &Limits::from(0.0, 10.0, "N m s/rad"))?;
        }
        Ok(FlightEffects {
            flapping_moment: number(
                "flapping_moment_n_s2_per_rad",
                self.flapping_moment_n_s2_per_rad,
                Limits::from(0.0, 1.0, "N s²/rad"),
            )?,
            rate_damping: self.rate_damping_n_m_s_per_rad,
            rotor_inertia: number(
                "rotor_inertia_kg_m2",
                self.rotor_inertia_kg_m2,
                Limits::from(0.0, 1.0, "kg m²"),
            )?,
            body_drag: number(
                "body_drag_n_s2_per_m2",
                self.body_drag_n_s2_per_m2,
                Limits::from(0.0, 10.0, "N s²/m²"),
            )?,
            battery_sag: number("battery_sag", self.battery_sag, Limits::from(0.0, 0.3, ""))?,
        })
    }
}

/// Shortest and longest lever of a rotor.
const LEVER_LIMITS: Limits = Limits::from(0.001, 5.0, "m");

/// `value` in double precision, if it is within `limits`.
fn within(field: &Field<'_>, value: f64, limits: &Limits) -> Result<f64, ConfigError> {
    field.number(value, limits).map(|_| value)
}

/// Moments of inertia that a body can have: none is more than the sum of the other two.
fn inertia(moments: [f64; 3], field: &Field<'_>) -> Result<[f64; 3], ConfigError> {
    for (axis, moment) in moments.into_iter().enumerate() {
        within(&field.at(axis), moment, &Limits::from(1e-9, 100.0, "kg m²"))?;
    }
    let sum: f64 = moments.iter().sum();
    match moments.iter().position(|moment| *moment > (sum - moment) * (1.0 + 1e-9)) {
        None => Ok(moments),
        Some(axis) => {
            Err(field.at(axis).refuse(moments[axis], "at most the sum of the other two, as of any body"))
        }
    }
}

/// A rotor's time constant \[s\].
fn lag(field: &Field<'_>, secs: Option<f64>, default: f64) -> Result<f64, ConfigError> {
    secs.map_or(Ok(default), |secs| within(field, secs, &Limits::from(0.001, 10.0, "s")))
}

impl LayoutConfig {
    fn check(&self, field: &Field<'_>) -> Result<Layout, ConfigError> {
        match *self {
            Self::Cross { x_m, y_m } => {
                let field = field.at("cross");
                Ok(Layout::Cross {
                    x: within(&field.at("x_m"), x_m, &LEVER_LIMITS)?,
                    y: within(&field.at("y_m"), y_m, &LEVER_LIMITS)?,
                })
            }
            Self::Plus { arm_m } => {
                Ok(Layout::Plus { arm: within(&field.at("plus").at("arm_m"), arm_m, &LEVER_LIMITS)? })
            }
        }
    }
}

impl RotorNumbering {
    const fn order(self) -> RotorOrder {
        match self {
            Self::Clockwise => RotorOrder::Clockwise,
            Self::CounterClockwise => RotorOrder::CounterClockwise,
        }
    }
}

impl DownwashConfig {
    fn check(&self, field: &Field<'_>) -> Result<Downwash, ConfigError> {
        Ok(Downwash {
            strength: within(&field.at("strength_n"), self.strength_n, &Limits::from(0.0, 1e7, "N"))?,
            width_slope: within(&field.at("width_slope"), self.width_slope, &Limits::from(0.0, 10.0, ""))?,
            width_offset: within(
                &field.at("width_offset_m"),
                self.width_offset_m,
                &Limits::from(-10.0, 10.0, "m"),
            )?,
        })
    }
}

impl CollisionConfig {
    /// Radius, height and offset \[m\].
    fn check(&self, field: &Field<'_>) -> Result<(f64, f64, f64), ConfigError> {
        let limits = Limits::from(0.001, 5.0, "m");
        Ok((
            within(&field.at("radius_m"), self.radius_m, &limits)?,
            within(&field.at("height_m"), self.height_m, &limits)?,
            within(&field.at("offset_m"), self.offset_m, &Limits::from(-5.0, 5.0, "m"))?,
        ))
    }
}

impl Serialize for AirframeConfig {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match self {
            Self::Known(known) => known.serialize(serializer),
            Self::Custom(numbers) => numbers.serialize(serializer),
        }
    }
}

impl<'de> Deserialize<'de> for AirframeConfig {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_any(NameOrNumbers)
    }
}

struct NameOrNumbers;

impl<'de> Visitor<'de> for NameOrNumbers {
    type Value = AirframeConfig;

    fn expecting(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str(
            "`cf2x`, `crazyflie_2_1`, `crazyflie_2_1_brushless`, `crazyflie_2_1_plus`, `crazyflie_2_1_thrust_upgrade`, \
             `bolt_5_inch`, `x500`, `cf2p`, `hb`, `racer` or an airframe in numbers",
        )
    }

    fn visit_str<E: serde::de::Error>(self, name: &str) -> Result<AirframeConfig, E> {
        KnownAirframe::deserialize(StrDeserializer::new(name)).map(AirframeConfig::Known)
    }

    fn visit_map<A: MapAccess<'de>>(self, numbers: A) -> Result<AirframeConfig, A::Error> {
        Box::deserialize(MapAccessDeserializer::new(numbers)).map(AirframeConfig::Custom)
    }
}

impl JsonSchema for AirframeConfig {
    fn schema_name() -> std::borrow::Cow<'static, str> {
        "AirframeConfig".into()
    }

    fn json_schema(generator: &mut SchemaGenerator) -> Schema {
        let known = generator.subschema_for::<KnownAirframe>();
        let custom = generator.subschema_for::<AirframeNumbers>();
        json_schema!({ "description": "A drone, by name or in numbers.", "oneOf": [known, custom] })
    }
}

#[cfg(test)]
mod tests;
