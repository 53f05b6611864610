//! Where the world lies on Earth: world coordinates to latitude, longitude and altitude, and back.
//!
//! The world is the plane that touches the ellipsoid of WGS 84 at [`Home`]: x east, y north, z up. Both ways go
//! through Earth-centred coordinates in f64 and are exact to a micrometre; what limits them within a kilometre of
//! home are the f32 of the world (0.06 mm) and, in messages, the integers of 10⁻⁷ degrees (steps of 11 mm).
//! The plane is flat: 1 km from home its z = 0 lies 78 mm above the ellipsoid.
//!
//! Altitudes above sea level are taken as heights above the ellipsoid. The geoid's tens of metres between them
//! would scale distances by less than 2·10⁻⁵, and nothing here meets an instrument that knows the difference.

use core::str::FromStr;

use nalgebra::{Matrix3, Vector3};

use crate::excerpt::Excerpt;

/// Semi-major axis of the ellipsoid \[m\] (WGS 84).
const EQUATOR_RADIUS_M: f64 = 6_378_137.0;

/// Flattening of the ellipsoid (WGS 84).
const FLATTENING: f64 = 1.0 / 298.257_223_563;

/// Square of its first eccentricity.
const ECCENTRICITY_SQUARED: f64 = FLATTENING * (2.0 - FLATTENING);

/// Steps of a degree in the integers of messages.
const STEPS_PER_DEGREE: f64 = 1e7;

/// Home altitudes \[m\]: from the shore of the Dead Sea to the top of Everest.
const ALTITUDES_M: core::ops::RangeInclusive<f64> = -430.0..=8850.0;

/// A place on or above Earth.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Geodetic {
    /// North of the equator \[°\], -90 to 90.
    pub latitude_deg: f64,
    /// East of Greenwich \[°\], -180 to 180.
    pub longitude_deg: f64,
    /// Above sea level \[m\].
    pub altitude_m: f64,
}

/// The place of the world's origin: the floor where a drone starts.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Home {
    /// North of the equator \[°\], -90 to 90.
    pub latitude_deg: f64,
    /// East of Greenwich \[°\], -180 to 180.
    pub longitude_deg: f64,
    /// Above sea level \[m\].
    pub altitude_m: f64,
}

/// Why a text is no place.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum HomeError {
    /// Not three parts.
    #[error(
        "expected LATITUDE,LONGITUDE,ALTITUDE in degrees and metres, such as 47.397742,8.545594,488, found {0}"
    )]
    Parts(Excerpt),
    /// One of them is no number.
    #[error("expected a number as {part}, found {found}")]
    Number {
        /// Its name.
        part: &'static str,
        /// What stands there.
        found: Excerpt,
    },
    /// One of them is no place on Earth.
    #[error("expected {part} from {least} to {greatest}, found {found}")]
    Range {
        /// Its name and unit.
        part: &'static str,
        /// Smallest value.
        least: f64,
        /// Greatest value.
        greatest: f64,
        /// What stands there.
        found: f64,
    },
}

impl core::fmt::Display for Home {
    fn fmt(&self, formatter: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        let Self { latitude_deg, longitude_deg, altitude_m } = self;
        write!(formatter, "{latitude_deg},{longitude_deg},{altitude_m}")
    }
}

impl Default for Home {
    /// Zurich, where PX4's simulation starts by default.
    fn default() -> Self {
        Self { latitude_deg: 47.397_742, longitude_deg: 8.545_594, altitude_m: 488.0 }
    }
}

impl FromStr for Home {
    type Err = HomeError;

    /// Of `LATITUDE,LONGITUDE,ALTITUDE`.
    fn from_str(text: &str) -> Result<Self, HomeError> {
        let mut parts = text.split(',');
        let (Some(latitude), Some(longitude), Some(altitude), None) =
            (parts.next(), parts.next(), parts.next(), parts.next())
        else {
            return Err(HomeError::Parts(text.into()));
        };
        Ok(Self {
            latitude_deg: within(latitude, "latitude [deg]", -90.0..=90.0)?,
            longitude_deg: within(longitude, "longitude [deg]", -180.0..=180.0)?,
            altitude_m: within(altitude, "altitude [m]", ALTITUDES_M)?,
        })
    }
}

fn within(text: &str, part: &'static str, range: core::ops::RangeInclusive<f64>) -> Result<f64, HomeError> {
    let Ok(found) = text.trim().parse() else {
        return Err(HomeError::Number { part, found: text.into() });
    };
    if range.contains(&found) {
        return Ok(found);
    }
    Err(HomeError::Range { part, least: *range.start(), greatest: *range.end(), found })
}

impl Home {
    /// The place of a point \[m, world\].
    pub fn place_of(&self, point: &Vector3<f32>) -> Geodetic {
        Geodetic::at(&(self.place().earth_centred() + self.axes().transpose() * point.map(f64::from)))
    }

    /// The point \[m, world\] of a place.
    pub fn point_at(&self, place: &Geodetic) -> Vector3<f32> {
        (self.axes() * (place.earth_centred() - self.place().earth_centred())).map(|coordinate| coordinate as f32)
    }

    /// Home itself as a place.
    pub fn place(&self) -> Geodetic {
        let Self { latitude_deg, longitude_deg, altitude_m } = *self;
        Geodetic { latitude_deg, longitude_deg, altitude_m }
    }

    /// East, north and up in Earth-centred coordinates, row by row.
    fn axes(&self) -> Matrix3<f64> {
        let (sine, cosine) = libm::sincos(self.latitude_deg.to_radians());
        let (longitude_sine, longitude_cosine) = libm::sincos(self.longitude_deg.to_radians());
        Matrix3::new(
            -longitude_sine,
            longitude_cosine,
            0.0,
            -sine * longitude_cosine,
            -sine * longitude_sine,
            cosine,
            cosine * longitude_cosine,
            cosine * longitude_sine,
            sine,
        )
    }
}

impl Geodetic {
    /// Of the integers in messages \[10⁻⁷ °\] and an altitude \[m\]; none if that is no place on Earth.
    pub fn from_integers([latitude, longitude]: [i32; 2], altitude_m: f32) -> Option<Self> {
        let [latitude_deg, longitude_deg] = [latitude, longitude].map(|angle| f64::from(angle) / STEPS_PER_DEGREE);
        let exists = latitude_deg.abs() <= 90.0 && longitude_deg.abs() <= 180.0 && altitude_m.is_finite();
        exists.then_some(Self { latitude_deg, longitude_deg, altitude_m: f64::from(altitude_m) })
    }

    /// Latitude and longitude in the integers of messages \[10⁻⁷ °\].
    pub fn integers(&self) -> [i32; 2] {
        [self.latitude_deg, self.longitude_deg].map(|angle| libm::round(angle * STEPS_PER_DEGREE) as i32)
    }

    /// Earth-centred coordinates \[m\]: x toward Greenwich on the equator, z toward the north pole.
    fn earth_centred(&self) -> Vector3<f64> {
        let (sine, cosine) = libm::sincos(self.latitude_deg.to_radians());
        let (longitude_sine, longitude_cosine) = libm::sincos(self.longitude_deg.to_radians());
        let radius = normal_radius_m(sine);
        let from_axis = (radius + self.altitude_m) * cosine;
        let north = (radius * (1.0 - ECCENTRICITY_SQUARED) + self.altitude_m) * sine;
        Vector3::new(from_axis * longitude_cosine, from_axis * longitude_sine, north)
    }

    /// The place of Earth-centred coordinates \[m\], by Bowring's formula (Survey Review 181, 1976): exact on the
    /// ellipsoid, and to 0.1 µm within 10 km of it.
    fn at(point: &Vector3<f64>) -> Self {
        let from_axis = libm::hypot(point.x, point.y);
        let polar_radius = EQUATOR_RADIUS_M * (1.0 - FLATTENING);
        let second_eccentricity_squared = ECCENTRICITY_SQUARED / (1.0 - ECCENTRICITY_SQUARED);
        let reduced = libm::atan2(point.z * EQUATOR_RADIUS_M, from_axis * polar_radius);
        let (sine, cosine) = libm::sincos(reduced);
        let latitude = libm::atan2(
            point.z + second_eccentricity_squared * polar_radius * sine * sine * sine,
            from_axis - ECCENTRICITY_SQUARED * EQUATOR_RADIUS_M * cosine * cosine * cosine,
        );
        let (sine, cosine) = libm::sincos(latitude);
        // This form of the height has no division that fails at the poles.
        let altitude_m =
            from_axis * cosine + point.z * sine - EQUATOR_RADIUS_M * EQUATOR_RADIUS_M / normal_radius_m(sine);
        Self {
            latitude_deg: latitude.to_degrees(),
            longitude_deg: libm::atan2(point.y, point.x).to_degrees(),
            altitude_m,
        }
    }
}

/// Radius of curvature across the meridian \[m\].
fn normal_radius_m(latitude_sine: f64) -> f64 {
    EQUATOR_RADIUS_M / libm::sqrt(1.0 - ECCENTRICITY_SQUARED * latitude_sine * latitude_sine)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// The ellipse by its reduced latitude, without the formulas above.
    fn earth_centred(place: &Geodetic) -> [f64; 3] {
        let (latitude, longitude) = (place.latitude_deg.to_radians(), place.longitude_deg.to_radians());
        let reduced = ((1.0 - FLATTENING) * latitude.tan()).atan();
        let polar_radius = EQUATOR_RADIUS_M * (1.0 - FLATTENING);
        let from_axis = EQUATOR_RADIUS_M * reduced.cos() + place.altitude_m * latitude.cos();
        let north = polar_radius * reduced.sin() + place.altitude_m * latitude.sin();
        [from_axis * longitude.cos(), from_axis * longitude.sin(), north]
    }

    fn near(home: &Home, north_deg: f64, east_deg: f64, up_m: f64) -> Geodetic {
        Geodetic {
            latitude_deg: home.latitude_deg + north_deg,
            longitude_deg: home.longitude_deg + east_deg,
            altitude_m: home.altitude_m + up_m,
        }
    }

    #[test]
    fn home_is_the_origin() {
        let home = Home::default();
        assert_eq!(home.point_at(&home.place()), Vector3::zeros());
        let place = home.place_of(&Vector3::zeros());
        assert_eq!(place.integers(), [473_977_420, 85_455_940]);
        assert!((place.altitude_m - 488.0).abs() < 1e-6);
    }

    #[test]
    fn a_degree_of_the_parallel_has_its_closed_form() {
        let home = Home::default();
        let (sine, cosine) = home.latitude_deg.to_radians().sin_cos();
        let radius = (normal_radius_m(sine) + home.altitude_m) * cosine;
        let turn = 0.01_f64;
        let (turn_sine, turn_cosine) = turn.to_radians().sin_cos();
        let expected =
            [radius * turn_sine, radius * sine * (1.0 - turn_cosine), radius * cosine * (turn_cosine - 1.0)];
        let found = home.point_at(&near(&home, 0.0, turn, 0.0));
        for (found, expected) in found.iter().zip(expected) {
            assert!((f64::from(*found) - expected).abs() < 1e-4, "{found} instead of {expected}");
        }
    }

    #[test]
    fn the_plane_leaves_the_ellipsoid_by_78_mm_in_a_kilometre() {
        let place = Home::default().place_of(&Vector3::new(0.0, 1000.0, 0.0));
        assert!((place.altitude_m - 488.0 - 0.0785).abs() < 2e-4, "{}", place.altitude_m);
    }

    #[test]
    fn altitude_is_height_everywhere() {
        for (latitude_deg, longitude_deg) in
            [(0.0, 0.0), (90.0, 0.0), (-90.0, 120.0), (-33.9, 151.2), (64.1, -21.9)]
        {
            let home = Home { latitude_deg, longitude_deg, altitude_m: 10.0 };
            let point = home.point_at(&near(&home, 0.0, 0.0, 25.0));
            assert!((point - Vector3::new(0.0, 0.0, 25.0)).norm() < 1e-5, "{point}");
            let place = home.place_of(&Vector3::new(0.0, 0.0, 25.0));
            assert!((place.altitude_m - 35.0).abs() < 1e-6 && (place.latitude_deg - latitude_deg).abs() < 1e-9);
        }
    }

    #[test]
    fn a_home_is_read_from_the_command_line() {
        assert_eq!("47.397742,8.545594,488".parse(), Ok(Home::default()));
        let south = Home { latitude_deg: -33.9, longitude_deg: 151.2, altitude_m: 0.0 };
        assert_eq!(" -33.9, 151.2 ,0".parse(), Ok(south));
        let refused = [
            ("", "such as 47.397742,8.545594,488, found \"\""),
            ("1,2", "found \"1,2\""),
            ("1,2,3,4", "found \"1,2,3,4\""),
            ("1,east,3", "expected a number as longitude [deg], found \"east\""),
            ("91,2,3", "expected latitude [deg] from -90 to 90, found 91"),
            ("1,nan,3", "expected longitude [deg] from -180 to 180, found NaN"),
            ("1,2,inf", "expected altitude [m] from -430 to 8850, found inf"),
        ];
        for (text, expected) in refused {
            let error = text.parse::<Home>().unwrap_err().to_string();
            assert!(error.ends_with(expected), "{error}");
        }
    }

    #[test]
    fn integers_that_are_no_place_are_refused() {
        assert!(Geodetic::from_integers([900_000_000, -1_800_000_000], 0.0).is_some());
        assert!(Geodetic::from_integers([900_000_001, 0], 0.0).is_none());
        assert!(Geodetic::from_integers([0, 1_800_000_001], 0.0).is_none());
        assert!(Geodetic::from_integers([0, i32::MIN], 0.0).is_none());
        assert!(Geodetic::from_integers([0, 0], f32::NAN).is_none());
    }

    proptest! {
        #[test]
        fn points_are_those_of_the_exact_ellipsoid_to_a_millimetre(
            latitude_deg in -89.0_f64..89.0, longitude_deg in -180.0_f64..180.0,
            north in -0.009_f64..0.009, east in -0.009_f64..0.009, up in -100.0_f64..1000.0
        ) {
            let home = Home { latitude_deg, longitude_deg, altitude_m: 488.0 };
            let place = near(&home, north, east, up);
            let (here, there) = (earth_centred(&home.place()), earth_centred(&place));
            let chord = here.iter().zip(there).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt();
            let point = home.point_at(&place);
            prop_assert!((f64::from(point.norm()) - chord).abs() < 3e-4);
            let gravity = [latitude_deg.to_radians(), longitude_deg.to_radians()].map(f64::sin_cos);
            let [(sine, cosine), (east_sine, east_cosine)] = gravity;
            let height = (there[0] - here[0]) * cosine * east_cosine
                + (there[1] - here[1]) * cosine * east_sine
                + (there[2] - here[2]) * sine;
            prop_assert!((f64::from(point.z) - height).abs() < 1e-3);
        }

        #[test]
        fn there_and_back_is_exact_to_a_tenth_of_a_millimetre(
            latitude_deg in -89.9_f64..89.9, longitude_deg in -180.0_f64..180.0,
            x in -700.0_f32..700.0, y in -700.0_f32..700.0, z in -10.0_f32..700.0
        ) {
            let home = Home { latitude_deg, longitude_deg, altitude_m: 488.0 };
            let point = Vector3::new(x, y, z);
            prop_assert!((home.point_at(&home.place_of(&point)) - point).norm() < 1e-4);
        }

        #[test]
        fn integers_keep_a_place_to_a_step(x in -700.0_f32..700.0, y in -700.0_f32..700.0) {
            let home = Home::default();
            let place = home.place_of(&Vector3::new(x, y, 1.0));
            let read = Geodetic::from_integers(place.integers(), place.altitude_m as f32).unwrap();
            prop_assert!((home.point_at(&read) - Vector3::new(x, y, 1.0)).norm() < 0.008);
        }
    }
}
