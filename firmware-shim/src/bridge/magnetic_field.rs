//! Earth's magnetic field: the World Magnetic Model 2025.
//!
//! Spherical harmonics of degree 12 (Chulliat et al., *The US/UK World Magnetic Model for 2025-2030*, NOAA 2025). The
//! coefficients are the published ones, in the public domain; the packages `world_magnetic_model` 1.2025.0 (crates.io) and
//! `pygeomag` 1.1.0 (PyPI) have the same ninety rows, bit for bit.

use crate::geodesy::Home;

/// Equatorial radius of WGS 84 \[m\].
const EQUATORIAL_RADIUS_M: f64 = 6_378_137.0;

/// Square of the first eccentricity of WGS 84.
const ECCENTRICITY_SQUARED: f64 = 6.694_379_990_141_316_5e-3;

/// Degree of the expansion.
const DEGREE: usize = 12;

/// Year to which the coefficients belong.
const EPOCH_YEAR: f64 = 2025.0;

/// Date of every simulated flight, the middle of the model's five years \[decimal year\]: a clock would make two runs
/// differ. Declinations of 2025 and 2030 are within half a degree of it in Europe.
pub const FLIGHT_YEAR: f64 = 2027.5;

/// Radius of the sphere of the expansion \[m\].
const REFERENCE_RADIUS_M: f64 = 6_371_200.0;

/// Functions of one degree by order, up to [`DEGREE`].
type Orders = [f64; DEGREE + 1];

/// North, east and down components of the field at a place \[nT\], at a date \[decimal year\].
pub fn field_ned_nanotesla(place: &Home, year: f64) -> [f64; 3] {
    let latitude = place.latitude_deg.to_radians();
    let (radius_m, geocentric_latitude) = geocentric(place, latitude);
    let functions = Legendre::of(geocentric_latitude);
    let longitude = place.longitude_deg.to_radians();
    let (mut north, mut east, mut down) = (0.0, 0.0, 0.0);
    for (index, row) in COEFFICIENTS.iter().enumerate() {
        let (degree, order) = degree_and_order(index);
        let age = year - EPOCH_YEAR;
        let (g, h) = (row[0] + age * row[2], row[1] + age * row[3]);
        let (sine, cosine) = libm::sincos(order as f64 * longitude);
        let strength = libm::pow(REFERENCE_RADIUS_M / radius_m, degree as f64 + 2.0);
        let along = strength * (g * cosine + h * sine);
        let across = strength * order as f64 * (g * sine - h * cosine);
        north += along * functions.slopes[degree][order];
        east += across * functions.values[degree][order] / libm::cos(geocentric_latitude);
        down -= along * (degree as f64 + 1.0) * functions.values[degree][order];
    }
    let (sine, cosine) = libm::sincos(geocentric_latitude - latitude);
    [north * cosine - down * sine, east, north * sine + down * cosine]
}

/// Distance from the centre of the Earth \[m\] and geocentric latitude \[rad\] of a place.
fn geocentric(place: &Home, latitude: f64) -> (f64, f64) {
    let (sine, cosine) = libm::sincos(latitude);
    let curvature = EQUATORIAL_RADIUS_M / libm::sqrt(1.0 - ECCENTRICITY_SQUARED * sine * sine);
    let across = (curvature + place.altitude_m) * cosine;
    let along = (curvature * (1.0 - ECCENTRICITY_SQUARED) + place.altitude_m) * sine;
    (libm::hypot(across, along), libm::atan2(along, across))
}

/// Degree and order of a row of the coefficients: degree 1 has two rows, and every further one has one more.
fn degree_and_order(index: usize) -> (usize, usize) {
    let mut order = index;
    let mut degree = 1;
    while order > degree {
        order -= degree + 1;
        degree += 1;
    }
    (degree, order)
}

/// Associated Legendre functions, Schmidt semi-normalised, of the sine of a latitude, and their slopes by colatitude.
struct Legendre {
    values: [Orders; DEGREE + 1],
    slopes: [Orders; DEGREE + 1],
}

impl Legendre {
    fn of(latitude: f64) -> Self {
        let (cosine, sine) = libm::sincos(latitude); // of the colatitude
        let mut all = Self { values: [[0.0; DEGREE + 1]; DEGREE + 1], slopes: [[0.0; DEGREE + 1]; DEGREE + 1] };
        all.values[0][0] = 1.0;
        for degree in 1..=DEGREE {
            for order in 0..degree {
                all.climb(degree, order, sine, cosine);
            }
            all.turn(degree, sine, cosine);
        }
        all
    }

    /// A function from the two of the same order and the degrees below it.
    fn climb(&mut self, degree: usize, order: usize, sine: f64, cosine: f64) {
        let (n, m) = (degree as f64, order as f64);
        let (value, slope) = (self.values[degree - 1][order], self.slopes[degree - 1][order]);
        let below = degree.checked_sub(2);
        let (older, older_slope) =
            below.map_or((0.0, 0.0), |two| (self.values[two][order], self.slopes[two][order]));
        let older_share = libm::sqrt(((n - 1.0) * (n - 1.0) - m * m).max(0.0));
        let scale = 1.0 / libm::sqrt(n * n - m * m);
        let twice = 2.0 * n - 1.0;
        self.values[degree][order] = scale * (twice * cosine * value - older_share * older);
        self.slopes[degree][order] = scale * (twice * (cosine * slope - sine * value) - older_share * older_slope);
    }

    /// The function whose order is its degree, from the one before it.
    fn turn(&mut self, degree: usize, sine: f64, cosine: f64) {
        let n = degree as f64;
        let scale = if degree == 1 { 1.0 } else { libm::sqrt((2.0 * n - 1.0) / (2.0 * n)) };
        let (value, slope) = (self.values[degree - 1][degree - 1], self.slopes[degree - 1][degree - 1]);
        self.values[degree][degree] = scale * sine * value;
        self.slopes[degree][degree] = scale * (sine * slope + cosine * value);
    }
}

/// g and h \[nT\] and their changes \[nT/year\], by degree and order.
const COEFFICIENTS: [[f64; 4]; 90] = [
    [-29_351.8, 0.0, 12.0, 0.0],
    [-1410.8, 4545.4, 9.7, -21.5],
    [-2556.6, 0.0, -11.6, 0.0],
    [2951.1, -3133.6, -5.2, -27.7],
    [1649.3, -815.1, -8.0, -12.1],
    [1361.0, 0.0, -1.3, 0.0],
    [-2404.1, -56.6, -4.2, 4.0],
    [1243.8, 237.5, 0.4, -0.3],
    [453.6, -549.5, -15.6, -4.1],
    [895.0, 0.0, -1.6, 0.0],
    [799.5, 278.6, -2.4, -1.1],
    [55.7, -133.9, -6.0, 4.1],
    [-281.1, 212.0, 5.6, 1.6],
    [12.1, -375.6, -7.0, -4.4],
    [-233.2, 0.0, 0.6, 0.0],
    [368.9, 45.4, 1.4, -0.5],
    [187.2, 220.2, 0.0, 2.2],
    [-138.7, -122.9, 0.6, 0.4],
    [-142.0, 43.0, 2.2, 1.7],
    [20.9, 106.1, 0.9, 1.9],
    [64.4, 0.0, -0.2, 0.0],
    [63.8, -18.4, -0.4, 0.3],
    [76.9, 16.8, 0.9, -1.6],
    [-115.7, 48.8, 1.2, -0.4],
    [-40.9, -59.8, -0.9, 0.9],
    [14.9, 10.9, 0.3, 0.7],
    [-60.7, 72.7, 0.9, 0.9],
    [79.5, 0.0, 0.0, 0.0],
    [-77.0, -48.9, -0.1, 0.6],
    [-8.8, -14.4, -0.1, 0.5],
    [59.3, -1.0, 0.5, -0.8],
    [15.8, 23.4, -0.1, 0.0],
    [2.5, -7.4, -0.8, -1.0],
    [-11.1, -25.1, -0.8, 0.6],
    [14.2, -2.3, 0.8, -0.2],
    [23.2, 0.0, -0.1, 0.0],
    [10.8, 7.1, 0.2, -0.2],
    [-17.5, -12.6, 0.0, 0.5],
    [2.0, 11.4, 0.5, -0.4],
    [-21.7, -9.7, -0.1, 0.4],
    [16.9, 12.7, 0.3, -0.5],
    [15.0, 0.7, 0.2, -0.6],
    [-16.8, -5.2, 0.0, 0.3],
    [0.9, 3.9, 0.2, 0.2],
    [4.6, 0.0, 0.0, 0.0],
    [7.8, -24.8, -0.1, -0.3],
    [3.0, 12.2, 0.1, 0.3],
    [-0.2, 8.3, 0.3, -0.3],
    [-2.5, -3.3, -0.3, 0.3],
    [-13.1, -5.2, 0.0, 0.2],
    [2.4, 7.2, 0.3, -0.1],
    [8.6, -0.6, -0.1, -0.2],
    [-8.7, 0.8, 0.1, 0.4],
    [-12.9, 10.0, -0.1, 0.1],
    [-1.3, 0.0, 0.1, 0.0],
    [-6.4, 3.3, 0.0, 0.0],
    [0.2, 0.0, 0.1, 0.0],
    [2.0, 2.4, 0.1, -0.2],
    [-1.0, 5.3, 0.0, 0.1],
    [-0.6, -9.1, -0.3, -0.1],
    [-0.9, 0.4, 0.0, 0.1],
    [1.5, -4.2, -0.1, 0.0],
    [0.9, -3.8, -0.1, -0.1],
    [-2.7, 0.9, 0.0, 0.2],
    [-3.9, -9.1, 0.0, 0.0],
    [2.9, 0.0, 0.0, 0.0],
    [-1.5, 0.0, 0.0, 0.0],
    [-2.5, 2.9, 0.0, 0.1],
    [2.4, -0.6, 0.0, 0.0],
    [-0.6, 0.2, 0.0, 0.1],
    [-0.1, 0.5, -0.1, 0.0],
    [-0.6, -0.3, 0.0, 0.0],
    [-0.1, -1.2, 0.0, 0.1],
    [1.1, -1.7, -0.1, 0.0],
    [-1.0, -2.9, -0.1, 0.0],
    [-0.2, -1.8, -0.1, 0.0],
    [2.6, -2.3, -0.1, 0.0],
    [-2.0, 0.0, 0.0, 0.0],
    [-0.2, -1.3, 0.0, 0.0],
    [0.3, 0.7, 0.0, 0.0],
    [1.2, 1.0, 0.0, -0.1],
    [-1.3, -1.4, 0.0, 0.1],
    [0.6, 0.0, 0.0, 0.0],
    [0.6, 0.6, 0.1, 0.0],
    [0.5, -0.1, 0.0, 0.0],
    [-0.1, 0.8, 0.0, 0.0],
    [-0.4, 0.1, 0.0, 0.0],
    [-0.2, -1.0, -0.1, 0.0],
    [-1.3, 0.1, 0.0, 0.0],
    [-0.7, 0.2, -0.1, -0.1],
];

#[cfg(test)]
mod tests {
    use super::*;

    fn place(latitude_deg: f64, longitude_deg: f64, altitude_m: f64) -> Home {
        Home { latitude_deg, longitude_deg, altitude_m }
    }

    #[test]
    fn the_published_test_values_come_out() {
        // The model's report, appendix of test values, as `pygeomag` 1.1.0 reproduces them with one digit more.
        for (place, year, expected) in [
            (place(80.0, 0.0, 0.0), 2025.0, [6521.60, 145.89, 54791.51]),
            (place(0.0, 120.0, 0.0), 2025.0, [39677.76, -109.61, -10580.17]),
            (place(-80.0, 240.0, 0.0), 2025.0, [6117.55, 15751.91, -52022.52]),
            (place(80.0, 0.0, 100_000.0), 2025.0, [6216.02, 92.44, 52598.83]),
            (place(-80.0, 240.0, 100_000.0), 2025.0, [5907.59, 14780.26, -49540.71]),
            (place(80.0, 0.0, 0.0), 2027.5, [6500.83, 294.53, 54869.36]),
            (place(-80.0, 240.0, 0.0), 2027.5, [6200.73, 15730.29, -51783.65]),
            (place(80.0, 0.0, 100_000.0), 2027.5, [6196.74, 233.78, 52670.47]),
            (place(-35.363_261, 149.165_23, 584.0), 2026.0, [23009.35, 5173.50, -53084.20]),
        ] {
            let found = field_ned_nanotesla(&place, year);
            for (found, expected) in found.iter().zip(expected) {
                assert!((found - expected).abs() < 0.01, "{found} nT instead of {expected} nT at {place}");
            }
        }
    }

    #[test]
    fn it_is_continuous_in_time_and_place() {
        let home = Home::default();
        let here = field_ned_nanotesla(&home, FLIGHT_YEAR);
        let near =
            field_ned_nanotesla(&Home { latitude_deg: home.latitude_deg + 1e-6, ..home }, FLIGHT_YEAR + 1e-6);
        for (a, b) in here.iter().zip(near) {
            assert!((a - b).abs() < 0.01);
        }
    }

    #[test]
    fn the_poles_are_places_too() {
        for latitude_deg in [-90.0, 90.0] {
            let pole = field_ned_nanotesla(&place(latitude_deg, 0.0, 0.0), FLIGHT_YEAR);
            let near = field_ned_nanotesla(&place(latitude_deg * (1.0 - 1e-7), 0.0, 0.0), FLIGHT_YEAR);
            for (a, b) in pole.iter().zip(near) {
                assert!((a - b).abs() < 0.1, "{pole:?} {near:?}");
            }
        }
    }

    #[test]
    fn rows_are_ordered_by_degree_and_order() {
        assert_eq!([0, 1, 2, 4, 5, 89].map(degree_and_order), [(1, 0), (1, 1), (2, 0), (2, 2), (3, 0), (12, 12)]);
    }
}
