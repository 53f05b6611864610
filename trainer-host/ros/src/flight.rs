//! A recording, moment by moment, as messages.

use std::path::Path;

use kestrel_core::airframe::GRAVITY;
use kestrel_core::attitude::Attitude;
use kestrel_draw::video::RecordedScene;
use kestrel_experiments::experiment_config::Experiment;
use kestrel_experiments::recording::{Moment, Placed, Recording, Track};
use kestrel_sim::camera::{Image, View};
use kestrel_sim::world;
use nalgebra::{Matrix3, Rotation3, UnitQuaternion, Vector3};

use crate::RosError;
use crate::bag::{Bag, stamp};
use crate::marker::{drone_frame, markers, movable_frame};
use crate::message::{
    ArrayDimension, CameraInfo, Float64, Float64MultiArray, Header, Imu, JointState, Odometry, Pose, PoseStamped,
    Quaternion, Range, RegionOfInterest, Text, Transform, TransformTree, Triple, Twist, TwistStamped,
    WithCovariance,
};
use crate::rangers::{LIMIT_M, RANGERS, Rangers};

/// Size of the images on board \[px\], angle of view across \[rad\], and time between two \[s\].
const IMAGE: [usize; 2] = [160, 120];
const VIEW_ANGLE: f64 = core::f64::consts::FRAC_PI_2;
const IMAGE_SECS: f64 = 0.1;

/// The rangers see in a cone of 27° \[rad\].
const RANGER_VIEW: f32 = 0.47;

/// The recording as a file; `path` is what messages call it.
///
/// # Errors
/// When its movable bodies are not those of its world, or a number in it is none.
pub fn mcap(recording: &Recording, experiment: &Experiment, path: &Path) -> Result<Vec<u8>, RosError> {
    let scenario = &experiment.evaluation.scenario;
    let scene = RecordedScene::new(recording.flight(experiment, path)?, scenario, &path.display().to_string())?;
    let world = &scenario.aviary.world;
    let control_secs = f64::from(scenario.physics.control_secs());
    let mut writer = FlightWriter {
        bag: Bag::new()?,
        rangers: Rangers::new(scenario),
        scene,
        control_secs,
        terms: recording.terms(),
    };
    writer.bag.push("/world", 0.0, &markers(world, &scenario.airframe, recording.drones.len()))?;
    let moments = recording.drones.iter().map(|track| track.moments.len()).max().unwrap_or(0);
    for moment in 0..moments {
        let secs = moment as f64 * control_secs;
        writer.movables(recording, moment, secs)?;
        for (drone, track) in recording.drones.iter().enumerate() {
            writer.drone(drone, track, moment)?;
        }
    }
    writer.bag.finish()
}

struct FlightWriter {
    bag: Bag,
    rangers: Rangers,
    scene: RecordedScene,
    control_secs: f64,
    /// What the reward's components are called, each once.
    terms: Vec<String>,
}

impl FlightWriter {
    /// Where the bodies that move are; all of them stay where they are last seen.
    fn movables(&mut self, recording: &Recording, moment: usize, secs: f64) -> Result<(), RosError> {
        let Some(bodies) = recording.movables.get(moment) else { return Ok(()) };
        let transforms = bodies.iter().enumerate().map(|(index, placed)| Transform {
            header: Header::new(stamp(secs), "world"),
            child_frame_id: movable_frame(index),
            pose: pose(placed),
        });
        self.bag.push("/tf", secs, &TransformTree { transforms: transforms.collect() })
    }

    fn drone(&mut self, drone: usize, track: &Track, index: usize) -> Result<(), RosError> {
        let secs = index as f64 * self.control_secs;
        let frame = drone_frame(drone);
        let topic = |name: &str| format!("/{frame}/{name}");
        if let Some(moment) = track.moments.get(index) {
            self.motion(&frame, track, index, moment)?;
            self.rangers(&frame, moment, secs)?;
            let per_image = (IMAGE_SECS / self.control_secs).round().max(1.0) as usize;
            if index.is_multiple_of(per_image) {
                self.image(drone, &frame, secs)?;
            }
        }
        if let Some(step) = track.steps.get(index) {
            let size = step.action.len() as u32;
            let dimension = ArrayDimension { label: "action".to_owned(), size, stride: size };
            let data = step.action.clone();
            let action = Float64MultiArray { dimensions: vec![dimension], data_offset: 0, data };
            self.bag.push(&topic("action"), secs, &action)?;
            for (name, paid) in self.terms.iter().zip(&step.rewards) {
                self.bag.push(&topic(&format!("reward/{name}")), secs, &Float64 { data: *paid })?;
            }
            if index + 1 == track.steps.len()
                && let Some(data) = track.outcome()
            {
                self.bag.push(&topic("outcome"), secs + self.control_secs, &Text { data })?;
            }
        }
        Ok(())
    }

    /// Where the drone is and how it moves.
    fn motion(&mut self, frame: &str, track: &Track, index: usize, moment: &Moment) -> Result<(), RosError> {
        let secs = index as f64 * self.control_secs;
        let topic = |name: &str| format!("/{frame}/{name}");
        let header = |of: &str| Header::new(stamp(secs), of);
        let attitude = attitude(moment);
        let velocity = Vector3::from(moment.velocity);
        let body_rates = Triple::from(moment.body_rates);
        let place = pose(&moment.placed);
        let transform = Transform { header: header("world"), child_frame_id: frame.to_owned(), pose: place };
        self.bag.push("/tf", secs, &TransformTree { transforms: vec![transform] })?;
        let in_body = Twist { linear: Triple::from(attitude.rotate_inverse(velocity)), angular: body_rates };
        let odometry = Odometry {
            header: header("world"),
            child_frame_id: frame.to_owned(),
            pose: WithCovariance { value: place, ..WithCovariance::default() },
            twist: WithCovariance { value: in_body, ..WithCovariance::default() },
        };
        self.bag.push(&topic("odom"), secs, &odometry)?;
        let angular = Triple::from(attitude.rotate(moment.body_rates.into()));
        let twist =
            TwistStamped { header: header("world"), twist: Twist { linear: Triple::from(velocity), angular } };
        self.bag.push(&topic("twist"), secs, &twist)?;
        let force = index.checked_sub(1).map(|before| self.specific_force(&track.moments[before], moment));
        let imu = Imu {
            header: header(frame),
            orientation: place.orientation,
            orientation_covariance: [0.0; 9],
            angular_velocity: body_rates,
            angular_velocity_covariance: [0.0; 9],
            linear_acceleration: Triple::from(
                force.unwrap_or_else(|| attitude.rotate_inverse(GRAVITY * Vector3::z())),
            ),
            linear_acceleration_covariance: [0.0; 9],
        };
        self.bag.push(&topic("imu"), secs, &imu)?;
        let rotors = JointState {
            header: header(frame),
            name: (0..moment.rotor_speeds.len()).map(|rotor| format!("rotor{rotor}")).collect(),
            position: Vec::new(),
            velocity: moment.rotor_speeds.into(),
            effort: Vec::new(),
        };
        self.bag.push(&topic("rotors"), secs, &rotors)?;
        let orientation = Quaternion { w: 1.0, ..Quaternion::default() };
        let goal = Pose { position: track.goal.into(), orientation };
        self.bag.push(&topic("goal"), secs, &PoseStamped { header: header("world"), pose: goal })
    }

    /// What an accelerometer felt on average between two moments \[m/s², body\].
    fn specific_force(&self, before: &Moment, now: &Moment) -> Vector3<f64> {
        let acceleration = (Vector3::from(now.velocity) - Vector3::from(before.velocity)) / self.control_secs;
        attitude(now).rotate_inverse(acceleration + GRAVITY * Vector3::z())
    }

    fn rangers(&mut self, frame: &str, moment: &Moment, secs: f64) -> Result<(), RosError> {
        let seen = self.rangers.measure(moment.placed.position.into(), &attitude(moment));
        for ((name, _), seen) in RANGERS.into_iter().zip(seen) {
            let range = Range {
                header: Header::new(stamp(secs), frame),
                radiation_type: 1,
                field_of_view: RANGER_VIEW,
                min_range: 0.0,
                max_range: LIMIT_M as f32,
                range: seen.map_or(f32::INFINITY, |metres| metres as f32),
                variance: 0.0,
            };
            self.bag.push(&format!("/{frame}/range/{name}"), secs, &range)?;
        }
        Ok(())
    }

    fn image(&mut self, drone: usize, frame: &str, secs: f64) -> Result<(), RosError> {
        let (view, image) = self.scene.on_board(drone, secs as f32, IMAGE, VIEW_ANGLE);
        let optical = format!("{frame}/camera");
        let header = Header::new(stamp(secs), &optical);
        let pose = optical_frame(&view);
        let placed =
            Transform { header: Header::new(stamp(secs), "world"), child_frame_id: optical.clone(), pose };
        self.bag.push("/tf", secs, &TransformTree { transforms: vec![placed] })?;
        self.bag.push(&format!("/{frame}/camera/camera_info"), secs, &calibration(header.clone()))?;
        self.bag.push(&format!("/{frame}/camera/image"), secs, &pixels(header, &image))
    }
}

fn attitude(moment: &Moment) -> Attitude<f64> {
    let [w, x, y, z] = moment.placed.attitude;
    Attitude { w, x, y, z }
}

fn pose(placed: &Placed) -> Pose {
    let [w, x, y, z] = placed.attitude;
    Pose::of(&world::Pose { position: placed.position.into(), world_from_body: Attitude { w, x, y, z } })
}

/// The frame of a camera: x right, y down, z along the optical axis.
fn optical_frame(view: &View) -> Pose {
    let axes = Matrix3::from_columns(&[view.right, view.down, view.forward]);
    let turn = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(axes));
    let orientation = Quaternion { x: turn.i, y: turn.j, z: turn.k, w: turn.w };
    Pose { position: Triple::from(view.eye), orientation }
}

fn calibration(header: Header) -> CameraInfo {
    let [columns, rows] = IMAGE;
    let focal = 0.5 * columns as f64 / (0.5 * VIEW_ANGLE).tan();
    let [middle_x, middle_y] = [0.5 * columns as f64, 0.5 * rows as f64];
    CameraInfo {
        header,
        height: rows as u32,
        width: columns as u32,
        distortion_model: "plumb_bob".to_owned(),
        d: vec![0.0; 5],
        k: [focal, 0.0, middle_x, 0.0, focal, middle_y, 0.0, 0.0, 1.0],
        r: [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
        p: [focal, 0.0, middle_x, 0.0, 0.0, focal, middle_y, 0.0, 0.0, 0.0, 1.0, 0.0],
        binning_x: 0,
        binning_y: 0,
        region_of_interest: RegionOfInterest::default(),
    }
}

fn pixels(header: Header, image: &Image) -> crate::message::Image {
    let [columns, rows] = IMAGE;
    crate::message::Image {
        header,
        height: rows as u32,
        width: columns as u32,
        encoding: "rgb8".to_owned(),
        is_bigendian: 0,
        step: 3 * columns as u32,
        data: image.colours.as_flattened().to_vec(),
    }
}
