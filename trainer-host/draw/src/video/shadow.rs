//! Shadows under drones, so that people see how high they are: soft, as under a clouded sky.

use kestrel_sim::camera::{Camera, Image, NOTHING, View};
use nalgebra::{Vector2, Vector3};

/// Radius of a shadow right under the drone, per length of the airframe's arm: a propeller reaches beyond the arm.
const RADIUS_ARMS: f64 = 1.7;

/// How much a shadow grows with the height of the drone \[1/m\], and how much it fades \[1/m\].
const GROWTH_PER_M: f64 = 0.3;
const FADING_PER_M: f64 = 0.7;

/// Share of the light that is missing right under a drone.
const DARKNESS: f64 = 0.55;

/// What is so little below a drone is a part of it, per length of the arm.
const HULL_ARMS: f64 = 0.5;

/// Nearer than this nothing is drawn \[m\].
const NEAREST_M: f64 = 0.05;

/// Darkens what is below drones \[m, world\], whose arms are so long \[m\], in an image of a camera.
pub(crate) fn cast(
    image: &mut Image,
    camera: &Camera,
    view: &View,
    drones: impl Iterator<Item = Vector3<f64>>,
    arm_m: f64,
) {
    for drone in drones {
        let [columns, rows] = bounds(camera, view, drone, arm_m);
        for row in rows {
            for column in columns.clone() {
                let pixel = row * camera.columns + column;
                if image.labels[pixel] != NOTHING {
                    let point = at(camera, view, [column, row], f64::from(image.depths[pixel]));
                    let light = 1.0 - darkness(drone, point, arm_m);
                    image.colours[pixel] = image.colours[pixel].map(|part| (f64::from(part) * light) as u8);
                }
            }
        }
    }
}

/// How much light a drone takes from a point.
fn darkness(drone: Vector3<f64>, point: Vector3<f64>, arm_m: f64) -> f64 {
    let height = drone.z - point.z;
    if height < HULL_ARMS * arm_m {
        return 0.0;
    }
    let radius = radius(height, arm_m);
    let share = 1.0 - (drone.xy() - point.xy()).norm_squared() / (radius * radius);
    if share <= 0.0 { 0.0 } else { DARKNESS * share.min(0.5) * 2.0 / (1.0 + FADING_PER_M * height) }
}

/// Of the shadow so far below \[m\].
fn radius(height: f64, arm_m: f64) -> f64 {
    RADIUS_ARMS * arm_m * (1.0 + GROWTH_PER_M * height)
}

/// The point that a pixel shows at a depth \[m\].
fn at(camera: &Camera, view: &View, pixel: [usize; 2], depth: f64) -> Vector3<f64> {
    let size = [camera.columns, camera.rows];
    let [aside, below] = [0, 1].map(|axis| {
        (2.0 * (pixel[axis] as f64 + camera.sample[axis]) / size[axis] as f64 - 1.0) * camera.tangents[axis]
    });
    view.eye + (view.forward + view.right * aside + view.down * below) * depth
}

/// Columns and rows in which something below a drone may be seen, down to the floor.
fn bounds(camera: &Camera, view: &View, drone: Vector3<f64>, arm_m: f64) -> [std::ops::Range<usize>; 2] {
    let size = [camera.columns, camera.rows];
    let reach = radius(drone.z.max(0.0), arm_m);
    let (mut low, mut high) = (Vector2::repeat(f64::MAX), Vector2::repeat(f64::MIN));
    for corner in 0..8 {
        let side = |bit: u8| if corner & bit == 0 { -reach } else { reach };
        let height = if corner & 4 == 0 { 0.0 } else { drone.z };
        let offset = Vector3::new(drone.x + side(1), drone.y + side(2), height) - view.eye;
        let depth = view.forward.dot(&offset);
        if depth < NEAREST_M {
            return size.map(|size| 0..size);
        }
        let seen = Vector2::new(
            view.right.dot(&offset) / (depth * camera.tangents[0]),
            view.down.dot(&offset) / (depth * camera.tangents[1]),
        );
        (low, high) = (low.inf(&seen), high.sup(&seen));
    }
    [0, 1].map(|axis| {
        let place = |share: f64| (0.5 * (share + 1.0) * size[axis] as f64).clamp(0.0, size[axis] as f64);
        place(low[axis]) as usize..place(high[axis]).ceil() as usize
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::video::camera;

    const ARM_M: f64 = 0.04;

    /// A white floor two metres below a camera that looks down.
    fn floor() -> (Image, Camera, View) {
        let camera = camera([80, 60], 1.0);
        let view = View::towards(Vector3::new(0.0, 0.0, 2.0), Vector3::zeros(), Vector3::x());
        let pixels = 80 * 60;
        let image = Image {
            columns: 80,
            depths: vec![2.0; pixels],
            labels: vec![1; pixels],
            colours: vec![[200; 3]; pixels],
        };
        (image, camera, view)
    }

    fn dark(image: &Image) -> Vec<usize> {
        (0..image.colours.len()).filter(|pixel| image.colours[*pixel][0] < 190).collect()
    }

    #[test]
    fn the_floor_is_dark_below_a_drone_and_nowhere_else() {
        let (mut image, camera, view) = floor();
        cast(&mut image, &camera, &view, [Vector3::new(0.0, 0.0, 0.3)].into_iter(), ARM_M);
        let pixels = dark(&image);
        assert!((10..200).contains(&pixels.len()), "{}", pixels.len());
        let middle = pixels.iter().map(|pixel| pixel % 80).sum::<usize>() / pixels.len();
        assert!((38..42).contains(&middle), "column {middle}");
        assert!(image.colours[30 * 80 + 40][0] > 80, "not black");
    }

    #[test]
    fn a_shadow_fades_with_height_and_leaves_sky_and_what_is_above_alone() {
        let darkest = |height: f64| {
            let (mut image, camera, view) = floor();
            cast(&mut image, &camera, &view, [Vector3::new(0.0, 0.0, height)].into_iter(), ARM_M);
            image.colours.iter().map(|colour| colour[0]).min().unwrap()
        };
        assert!(darkest(0.1) < darkest(0.5) && darkest(0.5) < darkest(1.5), "{} {}", darkest(0.1), darkest(1.5));
        assert_eq!(darkest(-0.5), 200, "it is below the floor");
        let (mut image, camera, view) = floor();
        image.labels.fill(NOTHING);
        cast(&mut image, &camera, &view, [Vector3::new(0.0, 0.0, 0.3)].into_iter(), ARM_M);
        assert!(dark(&image).is_empty());
    }
}
