//! Where on Earth the world's origin is.
//!
//! The world is the tangent plane at home, x east and y north, with the radii of curvature of WGS 84: at a kilometre from
//! home it is off by less than a decimetre.

use std::fmt;
use std::str::FromStr;

use nalgebra::Vector3;

/// Equatorial radius of WGS 84 \[m\].
pub(super) const EQUATORIAL_RADIUS_M: f64 = 6_378_137.0;

/// Square of the first eccentricity of WGS 84.
pub(super) const ECCENTRICITY_SQUARED: f64 = 6.694_379_990_141_316_5e-3;

/// Homes closer to a pole have no usable east \[deg\].
const LATITUDE_LIMIT_DEG: f64 = 89.0;

/// Homes lower or higher are no place for rotors, or outside the lowest layer of the standard atmosphere \[m\].
const ALTITUDES_M: core::ops::RangeInclusive<f64> = -500.0..=10_000.0;

/// The world's origin.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Home {
    /// Geodetic latitude, WGS 84 \[deg\].
    pub latitude_deg: f64,
    /// Longitude, WGS 84 \[deg\].
    pub longitude_deg: f64,
    /// Altitude above mean sea level \[m\], taken for the height above the ellipsoid as simulators do.
    pub altitude_m: f64,
}

/// A point near home.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GlobalPosition {
    /// Geodetic latitude, WGS 84 \[deg\].
    pub latitude_deg: f64,
    /// Longitude, WGS 84 \[deg\].
    pub longitude_deg: f64,
    /// Altitude above mean sea level \[m\].
    pub altitude_m: f64,
}

/// What is no [`Home`].
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "expected LATITUDE,LONGITUDE,ALTITUDE within ±{LATITUDE_LIMIT_DEG}° and ±180° and from {lowest} to {highest} m, found \"{0}\"",
    lowest = ALTITUDES_M.start(),
    highest = ALTITUDES_M.end()
)]
pub struct HomeError(String);

impl Default for Home {
    /// Zürich, where PX4's simulations begin.
    fn default() -> Self {
        Self { latitude_deg: 47.397_742, longitude_deg: 8.545_594, altitude_m: 488.0 }
    }
}

impl FromStr for Home {
    type Err = HomeError;

    fn from_str(text: &str) -> Result<Self, HomeError> {
        let mut numbers = text.split(',').map(|number| number.trim().parse::<f64>().ok());
        let mut next = || numbers.next().flatten().ok_or_else(|| HomeError(text.to_owned()));
        let home = Self { latitude_deg: next()?, longitude_deg: next()?, altitude_m: next()? };
        let inside = home.latitude_deg.abs() <= LATITUDE_LIMIT_DEG
            && home.longitude_deg.abs() <= 180.0
            && ALTITUDES_M.contains(&home.altitude_m);
        if inside && numbers.next().is_none() { Ok(home) } else { Err(HomeError(text.to_owned())) }
    }
}

impl fmt::Display for Home {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(formatter, "{},{},{}", self.latitude_deg, self.longitude_deg, self.altitude_m)
    }
}

impl Home {
    /// Where a point of the world \[m, ENU\] is on Earth.
    pub fn global(&self, position: &Vector3<f32>) -> GlobalPosition {
        let [per_degree_north, per_degree_east] = self.metres_per_degree();
        GlobalPosition {
            latitude_deg: self.latitude_deg + f64::from(position.y) / per_degree_north,
            longitude_deg: self.longitude_deg + f64::from(position.x) / per_degree_east,
            altitude_m: self.altitude_m + f64::from(position.z),
        }
    }

    /// Where a point on Earth is in the world \[m, ENU\].
    pub fn local(&self, global: &GlobalPosition) -> Vector3<f32> {
        let [per_degree_north, per_degree_east] = self.metres_per_degree();
        let east_deg = libm::remainder(global.longitude_deg - self.longitude_deg, 360.0);
        Vector3::new(
            (east_deg * per_degree_east) as f32,
            ((global.latitude_deg - self.latitude_deg) * per_degree_north) as f32,
            (global.altitude_m - self.altitude_m) as f32,
        )
    }

    /// Length of a degree to the north and to the east at home.
    fn metres_per_degree(&self) -> [f64; 2] {
        let (sine, cosine) = libm::sincos(self.latitude_deg.to_radians());
        let flattened = 1.0 - ECCENTRICITY_SQUARED * sine * sine;
        let across = EQUATORIAL_RADIUS_M / libm::sqrt(flattened);
        let along = across * (1.0 - ECCENTRICITY_SQUARED) / flattened;
        [along + self.altitude_m, (across + self.altitude_m) * cosine].map(f64::to_radians)
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn a_degree_has_the_length_of_the_tables() {
        // At 45° a degree of latitude is 111,132 m and one of longitude 78,847 m (WGS 84).
        let home = Home { latitude_deg: 45.0, longitude_deg: 0.0, altitude_m: 0.0 };
        let [north, east] = home.metres_per_degree();
        assert!((north - 111_132.0).abs() < 1.0 && (east - 78_847.0).abs() < 1.0, "{north} {east}");
    }

    #[test]
    fn east_is_longitude_and_north_is_latitude() {
        let home = Home::default();
        let east = home.global(&Vector3::new(100.0, 0.0, 0.0));
        let north = home.global(&Vector3::new(0.0, 100.0, 7.0));
        assert!(east.longitude_deg > home.longitude_deg && east.latitude_deg == home.latitude_deg);
        assert!(north.latitude_deg > home.latitude_deg && north.longitude_deg == home.longitude_deg);
        assert_eq!(north.altitude_m, 495.0);
    }

    #[test]
    fn the_date_line_is_no_wall() {
        let home = Home { latitude_deg: 10.0, longitude_deg: 179.999_99, altitude_m: 0.0 };
        let global = GlobalPosition { latitude_deg: 10.0, longitude_deg: -179.999_99, altitude_m: 0.0 };
        assert!((home.local(&global).x - 2.19).abs() < 0.01);
    }

    #[test]
    fn homes_are_three_numbers_on_earth() {
        assert_eq!("47.397742,8.545594,488".parse(), Ok(Home::default()));
        assert_eq!(Home::default().to_string().parse(), Ok(Home::default()));
        for wrong in ["", "1,2", "1,2,3,4", "90,0,0", "0,181,0", "0,0,20000", "nan,0,0", "0,inf,0", "a,b,c"] {
            let error = wrong.parse::<Home>().unwrap_err().to_string();
            assert!(error.contains(&format!("found \"{wrong}\"")), "{error}");
        }
    }

    proptest! {
        #[test]
        fn there_and_back_is_the_same_place(x in -1e3_f32..1e3, y in -1e3_f32..1e3, z in -1e2_f32..1e2) {
            let home = Home::default();
            let point = Vector3::new(x, y, z);
            prop_assert!((home.local(&home.global(&point)) - point).norm() < 1e-4);
        }
    }
}
