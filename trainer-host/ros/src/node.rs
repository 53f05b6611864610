//! A vehicle as a ROS 2 node: the topics of aerial robots, and the services of crazyswarm2, so that what was written for a real
//! Crazyflie flies a simulated one. The wire is DDS; no ROS is needed.
//!
//! | topic of `/cf1` | message | |
//! |---|---|---|
//! | `pose`, `odom` | `geometry_msgs/PoseStamped`, `nav_msgs/Odometry` | what the vehicle knows, 50 Hz; the twist in its own axes |
//! | `imu` | `sensor_msgs/Imu` | attitude, body rates, specific force: mean over the control period before |
//! | `battery`, `status` | `sensor_msgs/BatteryState`, `crazyflie_interfaces/Status` | |
//! | `cmd_vel` | `geometry_msgs/Twist` | heard: forward, left, up \[m/s\], counter-clockwise \[rad/s\] |
//! | `cmd_hover`, `cmd_position`, `cmd_velocity_world` | `crazyflie_interfaces/Hover`, … | heard |
//!
//! | service of `/cf1` and of `/all` | |
//! |---|---|
//! | `arm`, `emergency` | motors may turn; stop them in flight, too |
//! | `takeoff` | arms, and climbs to the height at the vehicle's own speed |
//! | `go_to` | to a point and a heading \[rad\] within a duration, as fast as the vehicle may |
//! | `land` | where it is; height and duration are the vehicle's own |
//! | `notify_setpoints_stop` | holds the point where it is |
//!
//! Beside them `/tf` (`world` to `cf1`), `/clock` with the simulated time, in which all stamps are, and `/rosout` with the
//! vehicle's own words. The node is a [`Link`]: it speaks to the vehicle as a ground station in the same process does.

mod interface;
mod outputs;
mod settings;
#[cfg(test)]
mod tests;

use std::collections::VecDeque;

use kestrel_onboard::axes::{enu_from_flu, enu_from_ned, flu_from_frd};
use kestrel_shim::flight_mode::FlightMode;
use kestrel_shim::frame::Frames;
use kestrel_shim::geodesy::Home;
use kestrel_shim::ground_station::{GroundStation, StationOrder};
use kestrel_shim::link::{DATAGRAM_LIMIT, EndpointId, Link, LinkError, Listeners, Received};
use kestrel_shim::steering::yaw;
use mavlink::dialects::common::{MavLandedState, MavMessage, MavModeFlag};
use mavlink::{MavlinkVersion, Message as _};
use nalgebra::{Rotation3, Vector3};
use ros2_client::error::CreateError;
use ros2_client::{Context, ContextOptions, MessageTypeName, Name, Node, NodeName, NodeOptions, QosProfile};
use ros2_client::{Server, ServiceTypeName, Subscription};
use serde::de::DeserializeOwned;

use self::interface::{
    Arm, Empty, GoTo, Hover, Land, NotifySetpointsStop, Position, Request, Takeoff, VelocityWorld,
};
use self::outputs::{Known, Outputs};
use crate::message::{Message, Twist};

pub use self::settings::{Middleware, NodeSettings, SettingsError};

/// Whose services every vehicle has, too.
const EVERYBODY: &str = "all";

/// The change to set-points is asked for again after this, until the vehicle says that it follows them \[s\].
const MODE_SECS: f64 = 0.2;

/// A hovering set-point climbs to its height with this gain \[1/s\], and not faster than this \[m/s\].
const CLIMB_GAIN: f32 = 2.0;
const CLIMB_SPEED: f32 = 0.5;

/// A flight to a point is at least as long \[s\]: the vehicle limits its speed itself.
const SHORTEST_SECS: f32 = 0.1;

/// `HIGHRES_IMU`, and how often it is wanted \[s\]: as often as the attitude comes.
const HIGHRES_IMU: u32 = 105;
const IMU_SECS: f32 = 0.02;

/// Why there is no node.
#[derive(Debug, thiserror::Error)]
pub enum NodeError {
    /// The name is none for ROS.
    #[error("found the ROS 2 name `{0}`, expected a letter, then letters, digits and single underscores")]
    Name(String),
    /// The network refuses, or a topic has a wrong name.
    #[error("cannot be a ROS 2 node: {0}")]
    Refused(String),
}

/// The node of one vehicle.
pub struct RosLink {
    /// Dropped before the node: both need the network.
    inputs: Inputs,
    outputs: Outputs,
    node: Node,
    station: GroundStation,
    /// What the station has for the vehicle.
    outgoing: VecDeque<Vec<u8>>,
    now_secs: f64,
    /// Whether the vehicle has told where it is.
    located: bool,
    mode: Option<FlightMode>,
    next_mode_secs: f64,
}

/// What others may ask for.
struct Inputs {
    arm: [Server<Arm, Empty>; 2],
    emergency: [Server<Empty, Empty>; 2],
    takeoff: [Server<Takeoff, Empty>; 2],
    land: [Server<Land, Empty>; 2],
    go_to: [Server<GoTo, Empty>; 2],
    stop: [Server<NotifySetpointsStop, Empty>; 2],
    velocity: Subscription<Twist>,
    hover: Subscription<Hover>,
    position: Subscription<Position>,
    velocity_world: Subscription<VelocityWorld>,
}

impl RosLink {
    /// A node called `name` for the vehicle with this MAVLink system, in a world whose origin is at `origin`.
    ///
    /// # Errors
    /// When the name is none, or the network refuses.
    pub fn open(name: &str, system: u8, origin: Home, settings: &NodeSettings) -> Result<Self, NodeError> {
        if !is_name(name) {
            return Err(NodeError::Name(name.to_owned()));
        }
        let refused = |error: &dyn std::fmt::Debug| NodeError::Refused(format!("{error:?}"));
        let options = ContextOptions::new().domain_id(settings.domain);
        let context = Context::with_options(options).map_err(|error| refused(&error))?;
        let own = NodeName::new("/", name).map_err(|error| refused(&error))?;
        let options = NodeOptions::new().enable_rosout(true);
        let mut node = context.new_node(own, options).map_err(|error| refused(&error))?;
        let spinner = node.spinner().map_err(|error| refused(&error))?;
        // It ends with the node, whose graph it keeps.
        std::thread::spawn(move || futures::executor::block_on(spinner.spin()));
        let inputs = Inputs::open(&mut node, name, settings).map_err(|error| refused(&error))?;
        let outputs = Outputs::open(&mut node, name).map_err(|error| refused(&error))?;
        let mut link = Self {
            inputs,
            outputs,
            node,
            station: GroundStation::new(system, origin),
            outgoing: VecDeque::new(),
            now_secs: 0.0,
            located: false,
            mode: None,
            next_mode_secs: 0.0,
        };
        link.order(&StationOrder::Interval(HIGHRES_IMU, IMU_SECS));
        Ok(link)
    }

    fn order(&mut self, order: &StationOrder) {
        let Self { station, outgoing, .. } = self;
        station.order(order, &mut |frame| outgoing.push_back(frame.to_vec()));
    }

    /// Sends a set-point, and asks the vehicle to follow set-points if it does not.
    fn follow(&mut self, set_point: &StationOrder) {
        self.order(set_point);
        if self.mode != Some(FlightMode::Offboard) && self.now_secs >= self.next_mode_secs {
            self.next_mode_secs = self.now_secs + MODE_SECS;
            self.order(&StationOrder::Mode(FlightMode::Offboard));
        }
    }

    /// Has the vehicle do what was asked for since the last period.
    fn obey(&mut self) {
        for Empty { .. } in requests(&self.inputs.emergency) {
            self.order(&StationOrder::StopMotors);
        }
        for Arm { arm } in requests(&self.inputs.arm) {
            self.order(if arm { &StationOrder::Arm } else { &StationOrder::Disarm });
        }
        for Takeoff { height, .. } in requests(&self.inputs.takeoff) {
            self.order(&StationOrder::Arm);
            let climb = height - self.known().position.z;
            self.order(&StationOrder::TakeOff(Some(climb)));
        }
        for request in requests(&self.inputs.go_to) {
            self.go_to(&request);
        }
        for Land { .. } in requests(&self.inputs.land) {
            self.order(&StationOrder::Mode(FlightMode::Land));
        }
        for NotifySetpointsStop { .. } in requests(&self.inputs.stop) {
            self.order(&StationOrder::Mode(FlightMode::Hold));
        }
        self.follow_set_points();
    }

    fn go_to(&mut self, request: &GoTo) {
        let Known { position, attitude, .. } = *self.known();
        let goal = request.goal.vector();
        let (point, heading) =
            if request.relative { (position + goal, yaw(&attitude) + request.yaw) } else { (goal, request.yaw) };
        let speed = (point - position).norm() / request.duration.secs().max(SHORTEST_SECS);
        self.order(&StationOrder::Speed(speed));
        self.order(&StationOrder::Position { point, heading: Some(heading) });
    }

    fn follow_set_points(&mut self) {
        let Known { position, attitude, .. } = *self.known();
        let ahead = Rotation3::from_axis_angle(&Vector3::z_axis(), yaw(&attitude));
        if let Some(Twist { linear, angular }) = latest(&self.inputs.velocity) {
            let velocity = ahead * linear.vector();
            self.follow(&StationOrder::Velocity { velocity, yaw_rate: Some(angular.z as f32) });
        }
        if let Some(Hover { vx, vy, yaw_rate, z_distance, .. }) = latest(&self.inputs.hover) {
            let climb = (CLIMB_GAIN * (z_distance - position.z)).clamp(-CLIMB_SPEED, CLIMB_SPEED);
            let velocity = ahead * Vector3::new(vx, vy, climb);
            self.follow(&StationOrder::Velocity { velocity, yaw_rate: Some(yaw_rate) });
        }
        if let Some(VelocityWorld { vel, yaw_rate, .. }) = latest(&self.inputs.velocity_world) {
            let velocity = vel.vector();
            self.follow(&StationOrder::Velocity { velocity, yaw_rate: Some(yaw_rate) });
        }
        if let Some(Position { x, y, z, yaw, .. }) = latest(&self.inputs.position) {
            self.follow(&StationOrder::Position { point: Vector3::new(x, y, z), heading: Some(yaw) });
        }
    }

    const fn known(&self) -> &Known {
        &self.outputs.known
    }

    /// Tells ROS what a frame of the vehicle tells.
    #[expect(clippy::wildcard_enum_match_arm, reason = "a message is one of the dialect's hundreds")]
    fn tell(&mut self, message: &MavMessage) {
        let Self { outputs, node, now_secs, located, mode, .. } = self;
        match message {
            MavMessage::HEARTBEAT(heartbeat) => {
                *mode = FlightMode::of_custom_mode(heartbeat.custom_mode);
                outputs.armed = heartbeat.base_mode.contains(MavModeFlag::MAV_MODE_FLAG_SAFETY_ARMED);
                outputs.tell_status(*now_secs);
            }
            MavMessage::EXTENDED_SYS_STATE(state) => {
                outputs.flying = state.landed_state != MavLandedState::MAV_LANDED_STATE_ON_GROUND;
            }
            MavMessage::BATTERY_STATUS(battery) => {
                outputs.tell_battery(*now_secs, battery.voltages[0], battery.battery_remaining);
            }
            MavMessage::HIGHRES_IMU(told) => {
                outputs.known.specific_force = flu_from_frd([told.xacc, told.yacc, told.zacc]);
            }
            // The inertial unit's comes before it.
            MavMessage::ATTITUDE_QUATERNION(told) => {
                outputs.known.attitude = enu_from_flu([told.q1, told.q2, told.q3, told.q4]);
                outputs.known.body_rates = flu_from_frd([told.rollspeed, told.pitchspeed, told.yawspeed]);
                outputs.tell_attitude(*now_secs);
            }
            MavMessage::LOCAL_POSITION_NED(told) => {
                outputs.known.position = enu_from_ned([told.x, told.y, told.z]);
                outputs.known.velocity = enu_from_ned([told.vx, told.vy, told.vz]);
                *located = true;
                outputs.tell_position(*now_secs);
            }
            MavMessage::STATUSTEXT(status) => {
                let words = status.text.to_str().unwrap_or_default();
                ros2_client::rosout!(*node, ros2_client::ros2::LogLevel::Info, "{words}");
            }
            _ => {}
        }
    }
}

impl Link for RosLink {
    fn advance(&mut self, now_secs: f64) -> Result<(), LinkError> {
        self.now_secs = now_secs;
        self.outputs.tell_clock(now_secs);
        let Self { station, outgoing, .. } = self;
        station.advance(now_secs, &mut |frame| outgoing.push_back(frame.to_vec()));
        // Before it knows where it is, the vehicle does nothing: requests wait.
        if self.located {
            self.obey();
        }
        Ok(())
    }

    fn receive<'b>(&mut self, buffer: &'b mut [u8; DATAGRAM_LIMIT]) -> Result<Option<Received<'b>>, LinkError> {
        let Some(frame) = self.outgoing.pop_front() else { return Ok(None) };
        let datagram = &mut buffer[..frame.len()];
        datagram.copy_from_slice(&frame);
        Ok(Some(Received { datagram, endpoint: EndpointId::ONLY }))
    }

    fn learn(&mut self, _endpoint: EndpointId) {}

    fn listeners(&self) -> Listeners {
        [EndpointId::ONLY].into_iter().collect()
    }

    fn send_to(&mut self, _endpoint: EndpointId, frame: &[u8]) {
        let Self { station, outgoing, .. } = self;
        station.hear(frame, &mut |frame| outgoing.push_back(frame.to_vec()));
        for frame in Frames::new(frame).flatten() {
            if let Ok(message) = MavMessage::parse(MavlinkVersion::V2, frame.message_id, frame.payload) {
                self.tell(&message);
            }
        }
    }
}

impl Inputs {
    fn open(node: &mut Node, name: &str, settings: &NodeSettings) -> Result<Self, CreateError> {
        Ok(Self {
            arm: servers(node, name, "arm", settings)?,
            emergency: servers(node, name, "emergency", settings)?,
            takeoff: servers(node, name, "takeoff", settings)?,
            land: servers(node, name, "land", settings)?,
            go_to: servers(node, name, "go_to", settings)?,
            stop: servers(node, name, "notify_setpoints_stop", settings)?,
            velocity: subscription(node, name, "cmd_vel")?,
            hover: subscription(node, name, "cmd_hover")?,
            position: subscription(node, name, "cmd_position")?,
            velocity_world: subscription(node, name, "cmd_velocity_world")?,
        })
    }
}

/// A service of the vehicle's own name, and of everybody's.
fn servers<Q: Request>(
    node: &mut Node,
    name: &str,
    service: &str,
    settings: &NodeSettings,
) -> Result<[Server<Q, Empty>; 2], CreateError> {
    let mut server = |whose: &str| {
        let (package, kind) = Q::SERVICE;
        let quality = QosProfile::publisher_default();
        let place = place(whose, service);
        let kind = ServiceTypeName::new(package, kind);
        node.create_server(settings.mapping.of_services(), &place, &kind, quality.clone(), quality)
    };
    Ok([server(name)?, server(EVERYBODY)?])
}

fn subscription<M: Message + 'static>(
    node: &mut Node,
    name: &str,
    topic: &str,
) -> Result<Subscription<M>, CreateError> {
    let quality = QosProfile::subscription_default();
    let topic = node.create_topic(&place(name, topic), type_of::<M>(), &quality)?;
    node.create_subscription(&topic, None)
}

/// Package and name of a message.
fn type_of<M: Message>() -> MessageTypeName {
    let (package, name) = M::NAME.split_once('/').unwrap_or(("", M::NAME));
    MessageTypeName::new(package, name)
}

/// The full name of a topic or service of a vehicle.
///
/// # Panics
/// When one of them is no name.
fn place(whose: &str, what: &str) -> Name {
    Name::new(&format!("/{whose}"), what).expect("names were checked")
}

/// What was asked of a service, answered: requests have no results, and what comes of one is told by topics.
fn requests<Q: Request>(servers: &[Server<Q, Empty>]) -> Vec<Q> {
    let of = |server: &Server<Q, Empty>| {
        let (identity, request) = server.receive_request().ok()??;
        // Who asked may be gone.
        let _ = server.send_response(identity, Empty::default());
        Some(request)
    };
    servers.iter().flat_map(|server| std::iter::from_fn(move || of(server))).collect()
}

/// The last message that has come, if one has.
fn latest<M: DeserializeOwned + 'static>(subscription: &Subscription<M>) -> Option<M> {
    std::iter::from_fn(|| subscription.take().ok()?).last().map(|(message, _)| message)
}

/// Whether ROS takes it as a part of a topic's name.
fn is_name(name: &str) -> bool {
    let letters = name.chars().all(|letter| letter.is_ascii_alphanumeric() || letter == '_');
    letters && name.starts_with(|first: char| first.is_ascii_alphabetic()) && !name.contains("__")
}
