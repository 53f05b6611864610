//! Worlds of things strewn about, for tests of what renders them: those here, and those of the GPU.

use super::{Attitude, Mesh, Purpose, Role, Seed, Shape, Solid, Stream, Triangle, Vector3, World};

/// A world of solids of every shape, strewn about and turned at random.
pub(crate) fn strewn(seed: u64, count: usize) -> World {
    let mut stream = Stream::new(Seed(seed), 0, Purpose::Furnishing);
    let solids = (0..count).map(|index| {
        let mut between = |low: f32, high: f32| f64::from(stream.between(low, high));
        let mut solid = Solid::block("thing", Vector3::repeat(-0.1), Vector3::repeat(0.1));
        solid.shape = match index % 4 {
            0 => Shape::Cuboid(Vector3::new(between(0.05, 0.4), between(0.05, 0.4), between(0.05, 0.4))),
            1 => Shape::Cylinder { radius: between(0.05, 0.3), half_height: between(0.05, 0.5) },
            2 => Shape::Sphere(between(0.05, 0.4)),
            _ => {
                let corner = |_| Vector3::new(between(-0.4, 0.4), between(-0.4, 0.4), between(-0.4, 0.4));
                Shape::Hull((0..12).map(corner).collect())
            }
        };
        let axis = stream.direction().cast::<f64>();
        let (sine, cosine) = f64::from(stream.between(0.0, 3.0)).sin_cos();
        solid.pose.world_from_body = Attitude { w: cosine, x: sine * axis.x, y: sine * axis.y, z: sine * axis.z };
        let mut between = |low: f32, high: f32| f64::from(stream.between(low, high));
        solid.pose.position = Vector3::new(between(1.0, 4.0), between(-1.5, 1.5), between(0.3, 2.0));
        solid.role = Role::Obstacle;
        solid
    });
    World { solids: solids.collect(), ..World::empty() }
}

/// A ring of triangles about z, not convex, whose every seventh is red.
pub(crate) fn ring(radius: f64, thickness: f64, around: u32, across: u32) -> Shape {
    let angle = |step: u32, steps: u32| (std::f64::consts::TAU * f64::from(step) / f64::from(steps)).sin_cos();
    let place = |index: u32| {
        let ((sine, cosine), (rise, out)) = (angle(index / across, around), angle(index % across, across));
        let from_axis = radius + thickness * out;
        Vector3::new(from_axis * cosine, from_axis * sine, thickness * rise)
    };
    let corners: Vec<_> = (0..around * across).map(place).collect();
    let corner = |i: u32, j: u32| i % around * across + j % across;
    let square = |index: u32| {
        let (i, j) = (index / across, index % across);
        let [a, b, c, d] = [corner(i, j), corner(i + 1, j), corner(i + 1, j + 1), corner(i, j + 1)];
        let colour = index.is_multiple_of(7).then_some([1.0, 0.0, 0.0]);
        [[a, b, c], [a, c, d]].map(|corners| Triangle { corners, colour })
    };
    let triangles = (0..around * across).flat_map(square).collect();
    Shape::Mesh(Mesh { hull: corners.clone(), corners, triangles })
}

/// As [`strewn`], with rings of some hundred triangles for every other solid.
pub(crate) fn strewn_rings(seed: u64, count: usize) -> World {
    let mut world = strewn(seed, count);
    for (index, solid) in world.solids.iter_mut().enumerate().step_by(2) {
        let size = 0.2 + 0.05 * index as f64;
        solid.shape = ring(size, 0.3 * size, 20, 10 + index as u32);
    }
    world
}
