//! What the node tells.

use kestrel_core::attitude::Attitude;
use nalgebra::Vector3;
use ros2_client::error::CreateError;
use ros2_client::{Node, Publisher, QosProfile};

use super::interface::{BatteryState, Clock, Status};
use super::{place, type_of};
use crate::message::{
    Header, Imu, Message, Odometry, Pose, PoseStamped, Quaternion, Time, Transform, TransformTree, Triple, Twist,
    WithCovariance,
};

/// The frame in which positions are.
const WORLD: &str = "world";

/// Bits of `supervisor_info`: it can be armed, is, arms itself for a take-off, can fly, flies.
const CAN_BE_ARMED: u16 = 1;
const IS_ARMED: u16 = 2;
const ARMS_ITSELF: u16 = 4;
const CAN_FLY: u16 = 8;
const IS_FLYING: u16 = 16;

/// Of `sensor_msgs/BatteryState`: it is being used, is good, and of lithium polymer.
const DISCHARGING: u8 = 2;
const GOOD: u8 = 1;
const LITHIUM_POLYMER: u8 = 3;

/// What the vehicle knows of itself.
#[derive(Clone, Copy, Debug)]
pub(super) struct Known {
    /// \[m, world\].
    pub(super) position: Vector3<f32>,
    /// \[m/s, world\].
    pub(super) velocity: Vector3<f32>,
    pub(super) attitude: Attitude<f32>,
    /// \[rad/s, body\].
    pub(super) body_rates: Vector3<f32>,
    /// \[m/s², body\].
    pub(super) specific_force: Vector3<f32>,
}

/// Publishers, and what was heard so far.
pub(super) struct Outputs {
    name: String,
    pub(super) known: Known,
    pub(super) armed: bool,
    pub(super) flying: bool,
    volts: f32,
    clock: Publisher<Clock>,
    tree: Publisher<TransformTree>,
    pose: Publisher<PoseStamped>,
    odometry: Publisher<Odometry>,
    imu: Publisher<Imu>,
    battery: Publisher<BatteryState>,
    status: Publisher<Status>,
}

impl Outputs {
    pub(super) fn open(node: &mut Node, name: &str) -> Result<Self, CreateError> {
        let (velocity, body_rates, specific_force) = (Vector3::zeros(), Vector3::zeros(), Vector3::zeros());
        let attitude = Attitude { w: 1.0, x: 0.0, y: 0.0, z: 0.0 };
        Ok(Self {
            name: name.to_owned(),
            known: Known { position: Vector3::zeros(), velocity, attitude, body_rates, specific_force },
            armed: false,
            flying: false,
            volts: 0.0,
            clock: publisher(node, "", "clock")?,
            tree: publisher(node, "", "tf")?,
            pose: publisher(node, name, "pose")?,
            odometry: publisher(node, name, "odom")?,
            imu: publisher(node, name, "imu")?,
            battery: publisher(node, name, "battery")?,
            status: publisher(node, name, "status")?,
        })
    }

    pub(super) fn tell_clock(&self, now_secs: f64) {
        tell(&self.clock, Clock { clock: Time::of(now_secs) });
    }

    pub(super) fn tell_position(&self, now_secs: f64) {
        let Known { position, velocity, attitude, body_rates, .. } = self.known;
        let header = Header::new(Time::of(now_secs), WORLD);
        let pose = Pose { position: triple(position), orientation: quaternion(&attitude) };
        let child_frame_id = self.name.clone();
        let placed = Transform { header: header.clone(), child_frame_id: child_frame_id.clone(), pose };
        tell(&self.tree, TransformTree { transforms: vec![placed] });
        tell(&self.pose, PoseStamped { header: header.clone(), pose });
        let own = Twist { linear: triple(attitude.rotate_inverse(velocity)), angular: triple(body_rates) };
        let covariance = [[0.0; 6]; 6];
        let odometry = Odometry {
            header,
            child_frame_id,
            pose: WithCovariance { value: pose, covariance },
            twist: WithCovariance { value: own, covariance },
        };
        tell(&self.odometry, odometry);
    }

    pub(super) fn tell_attitude(&self, now_secs: f64) {
        let imu = Imu {
            header: Header::new(Time::of(now_secs), &self.name),
            orientation: quaternion(&self.known.attitude),
            orientation_covariance: [0.0; 9],
            angular_velocity: triple(self.known.body_rates),
            angular_velocity_covariance: [0.0; 9],
            linear_acceleration: triple(self.known.specific_force),
            linear_acceleration_covariance: [0.0; 9],
        };
        tell(&self.imu, imu);
    }

    pub(super) fn tell_battery(&mut self, now_secs: f64, millivolts: u16, percent: i8) {
        self.volts = 1e-3 * f32::from(millivolts);
        let unknown = f32::NAN;
        let battery = BatteryState {
            header: Header::new(Time::of(now_secs), &self.name),
            voltage: self.volts,
            temperature: unknown,
            current: unknown,
            charge: unknown,
            capacity: unknown,
            design_capacity: unknown,
            percentage: 0.01 * f32::from(percent),
            power_supply_status: DISCHARGING,
            power_supply_health: GOOD,
            power_supply_technology: LITHIUM_POLYMER,
            present: true,
            ..BatteryState::default()
        };
        tell(&self.battery, battery);
    }

    pub(super) fn tell_status(&self, now_secs: f64) {
        let armed = if self.armed { IS_ARMED | CAN_FLY } else { 0 };
        let flying = if self.flying { IS_FLYING } else { 0 };
        let status = Status {
            header: Header::new(Time::of(now_secs), &self.name),
            supervisor_info: CAN_BE_ARMED | ARMS_ITSELF | armed | flying,
            battery_voltage: self.volts,
            ..Status::default()
        };
        tell(&self.status, status);
    }
}

fn publisher<M: Message>(node: &mut Node, name: &str, topic: &str) -> Result<Publisher<M>, CreateError> {
    let topic = node.create_topic(&place(name, topic), type_of::<M>(), &QosProfile::publisher_default())?;
    node.create_publisher(&topic, None)
}

/// Whoever is slow misses a message: the flight does not wait.
fn tell<M: Message>(publisher: &Publisher<M>, message: M) {
    let _ = publisher.publish(message);
}

fn triple(vector: Vector3<f32>) -> Triple {
    Triple::from(vector.cast::<f64>())
}

fn quaternion(attitude: &Attitude<f32>) -> Quaternion {
    let Attitude { w, x, y, z } = attitude.map(f64::from);
    Quaternion { x, y, z, w }
}
