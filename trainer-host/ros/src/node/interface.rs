//! What only a node says or hears: among others the messages and services of crazyswarm2's package `crazyflie_interfaces`,
//! field by field.

use serde::{Deserialize, Serialize};

use crate::message::{Header, Message, Time, Triple, Twist, messages};

/// What is asked of a service.
pub(crate) trait Request: ros2_client::Message + Clone + 'static {
    /// Package and name of the service.
    const SERVICE: (&'static str, &'static str);
}

macro_rules! requests {
    ($($request:ty: $package:literal $name:literal),+ $(,)?) => {
        $(
            impl ros2_client::Message for $request {}

            impl Request for $request {
                const SERVICE: (&'static str, &'static str) = ($package, $name);
            }
        )+
    };
}

requests! {
    Arm: "crazyflie_interfaces" "Arm",
    Empty: "std_srvs" "Empty",
    GoTo: "crazyflie_interfaces" "GoTo",
    Land: "crazyflie_interfaces" "Land",
    NotifySetpointsStop: "crazyflie_interfaces" "NotifySetpointsStop",
    Takeoff: "crazyflie_interfaces" "Takeoff",
}

messages! {
    BatteryState: "sensor_msgs/BatteryState",
    Clock: "rosgraph_msgs/Clock",
    Hover: "crazyflie_interfaces/Hover",
    Position: "crazyflie_interfaces/Position",
    Status: "crazyflie_interfaces/Status",
    Twist: "geometry_msgs/Twist",
    VelocityWorld: "crazyflie_interfaces/VelocityWorld",
}

/// Without fields, as the answer of every service is: ROS 2 sends a byte where there is nothing.
#[derive(Clone, Copy, Debug, Default, Serialize, Deserialize)]
pub(crate) struct Empty {
    pub(crate) structure_needs_at_least_one_member: u8,
}

#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
pub(crate) struct Arm {
    pub(crate) arm: bool,
}

#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
pub(crate) struct Takeoff {
    pub(crate) group_mask: u8,
    /// Above the floor \[m\].
    pub(crate) height: f32,
    pub(crate) duration: Time,
}

#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
pub(crate) struct Land {
    pub(crate) group_mask: u8,
    pub(crate) height: f32,
    pub(crate) duration: Time,
}

#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
pub(crate) struct GoTo {
    pub(crate) group_mask: u8,
    /// Whether the goal counts from where the drone is.
    pub(crate) relative: bool,
    /// \[m\], in the world's axes.
    pub(crate) goal: Triple,
    /// \[rad\], counter-clockwise.
    pub(crate) yaw: f32,
    pub(crate) duration: Time,
}

#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
pub(crate) struct NotifySetpointsStop {
    pub(crate) group_mask: u8,
    pub(crate) remain_valid_millisecs: u32,
}

/// Velocities in the drone's heading \[m/s\], a height \[m\].
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) struct Hover {
    pub(crate) header: Header,
    pub(crate) vx: f32,
    pub(crate) vy: f32,
    /// \[rad/s\].
    pub(crate) yaw_rate: f32,
    pub(crate) z_distance: f32,
}

/// A point \[m\] and a heading \[rad\] in the world.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) struct Position {
    pub(crate) header: Header,
    pub(crate) x: f32,
    pub(crate) y: f32,
    pub(crate) z: f32,
    pub(crate) yaw: f32,
}

/// A velocity \[m/s\] in the world's axes.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) struct VelocityWorld {
    pub(crate) header: Header,
    pub(crate) vel: Triple,
    /// \[rad/s\].
    pub(crate) yaw_rate: f32,
}

/// How the vehicle is; bits of the supervisor are in [`super::outputs`].
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub(crate) struct Status {
    pub(crate) header: Header,
    pub(crate) supervisor_info: u16,
    pub(crate) battery_voltage: f32,
    pub(crate) pm_state: u8,
    pub(crate) rssi: u8,
    pub(crate) num_rx_broadcast: u32,
    pub(crate) num_tx_broadcast: u32,
    pub(crate) num_rx_unicast: u32,
    pub(crate) num_tx_unicast: u32,
    pub(crate) latency_unicast: u16,
}

#[derive(Clone, Copy, Debug, Serialize)]
pub(crate) struct Clock {
    pub(crate) clock: Time,
}

/// What is not measured is NaN.
#[derive(Clone, Debug, Default, Serialize)]
pub(crate) struct BatteryState {
    pub(crate) header: Header,
    /// \[V\].
    pub(crate) voltage: f32,
    pub(crate) temperature: f32,
    pub(crate) current: f32,
    pub(crate) charge: f32,
    pub(crate) capacity: f32,
    pub(crate) design_capacity: f32,
    /// From 0 to 1.
    pub(crate) percentage: f32,
    pub(crate) power_supply_status: u8,
    pub(crate) power_supply_health: u8,
    pub(crate) power_supply_technology: u8,
    pub(crate) present: bool,
    pub(crate) cell_voltage: Vec<f32>,
    pub(crate) cell_temperature: Vec<f32>,
    pub(crate) location: String,
    pub(crate) serial_number: String,
}
