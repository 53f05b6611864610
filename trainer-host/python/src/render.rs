//! An environment as a camera behind its drones sees it.

use kestrel_core::real::Real;
use kestrel_sim::camera::{Camera, Canvas, Image, Mover, Scene, View};
use kestrel_sim::nalgebra::Vector3;
use kestrel_sim::simulation::Simulation;
use kestrel_sim::world::Pose;

/// From the drones to the camera: half a metre for a Crazyflie, as in the videos of `kestrel train`.
const DISTANCE_RADII: f64 = 8.0;

/// Behind, and 30° above \[m per m of distance, world\].
const TOWARDS_CAMERA: [f64; 3] = [-0.866, 0.0, 0.5];

/// Tangent of half the angle of view up, 45° in all.
const TANGENT: f64 = 0.414;

/// Colours `[rows][columns][3]` of the picture of an environment, `[rows, columns]` pixels large.
pub(crate) fn picture(simulation: &Simulation, environment: usize, [rows, columns]: [usize; 2]) -> Vec<u8> {
    let (scenario, environments) = (simulation.scenario(), simulation.environments());
    let mut scene =
        Scene::new(&scenario.aviary.world).with_drones(&scenario.airframe, scenario.agents.count as usize);
    for (index, pose) in simulation.movables(environment).iter().enumerate() {
        scene.place(Mover::Movable(index), pose);
    }
    let poses: Vec<Pose> = (environment..simulation.rows())
        .step_by(environments)
        .map(|row| {
            let state = simulation.state(row).map(Real::to_f64);
            Pose { position: state.position, world_from_body: state.world_from_body }
        })
        .collect();
    for (index, pose) in poses.iter().enumerate() {
        scene.place(Mover::Drone(index), pose);
    }
    let centre = poses.iter().map(|pose| pose.position).sum::<Vector3<f64>>() / poses.len() as f64;
    let spread = poses.iter().map(|pose| (pose.position - centre).norm()).fold(0.0, f64::max);
    let distance = DISTANCE_RADII * scenario.airframe.collision_radius + spread / TANGENT;
    let view = View::towards(centre + distance * Vector3::from(TOWARDS_CAMERA), centre, Vector3::z());
    let tangents = [TANGENT * columns as f64 / rows as f64, TANGENT];
    let camera = Camera { columns, rows, tangents, sample: [0.5; 2], ..Camera::REFERENCE };
    let mut image = Image::default();
    scene.render_into(&camera, &view, &mut Canvas::default(), &mut image);
    image.colours.into_iter().flatten().collect()
}
