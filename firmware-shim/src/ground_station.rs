//! A ground station without a screen, in the same process as the vehicle: what it sends is what a real one sends, byte for
//! byte, and it answers what an upload asks for. It knows no clock and no socket.

use std::f32::consts::FRAC_PI_2;

use mavlink::dialects::common::{
    COMMAND_LONG_DATA, HEARTBEAT_DATA, MISSION_COUNT_DATA, MISSION_ITEM_INT_DATA, MavAutopilot, MavCmd, MavFrame,
    MavMessage, MavType, PositionTargetTypemask, SET_POSITION_TARGET_LOCAL_NED_DATA,
};
use mavlink::{MavlinkVersion, Message, MessageData};
use nalgebra::Vector3;

use crate::flight_mode::FlightMode;
use crate::frame::{Encoder, Frames, Payload};
use crate::geodesy::Home;
use kestrel_onboard::axes::ned_from_enu;

/// System and component that ground stations have.
const STATION: [u8; 2] = [255, 190];

/// Time between two heartbeats \[s\].
const HEARTBEAT_SECS: f64 = 1.0;

/// The beginning of an upload that no request has answered is sent again after this \[s\].
const UPLOAD_SECS: f64 = 1.0;

/// Type mask of set-points: accelerations are never sent.
const NO_ACCELERATION: u16 = 0b0001_1100_0000;
const NO_POSITION: u16 = 0b0000_0000_0111;
const NO_VELOCITY: u16 = 0b0000_0011_1000;
const NO_YAW: u16 = 0b0100_0000_0000;
const NO_YAW_RATE: u16 = 0b1000_0000_0000;

/// `STATUSTEXT`, `MISSION_REQUEST`, `MISSION_REQUEST_INT` and `MISSION_ACK`: what is read of all that the vehicle says.
const READ: [u32; 4] = [253, 40, 51, 47];

/// What the user of a ground station has it send.
#[derive(Clone, Debug, PartialEq)]
pub enum StationOrder {
    /// Allow the motors to turn.
    Arm,
    /// Forbid it; refused in flight.
    Disarm,
    /// Stop the motors, in flight too.
    StopMotors,
    /// Climb by a height \[m\], or by the vehicle's own.
    TakeOff(Option<f32>),
    /// A set-point of a position, with a heading or any.
    Position {
        /// \[m, world\].
        point: Vector3<f32>,
        /// \[rad\], counter-clockwise from the world's x axis.
        heading: Option<f32>,
    },
    /// A set-point of a velocity, turning or not.
    Velocity {
        /// \[m/s, world\].
        velocity: Vector3<f32>,
        /// \[rad/s\], counter-clockwise.
        yaw_rate: Option<f32>,
    },
    /// Change to a mode.
    Mode(FlightMode),
    /// Go at another speed \[m/s\].
    Speed(f32),
    /// Send a message this often \[s\].
    Interval(u32, f32),
    /// Upload a mission.
    Upload(Vec<PlanItem>),
}

/// One item of a mission that is uploaded.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum PlanItem {
    /// Climb to a height above the world's origin \[m\].
    TakeOff(f32),
    /// Go to a point \[m, world\], and stay there for a time \[s\].
    Waypoint {
        /// Where.
        point: Vector3<f32>,
        /// How long.
        hold_secs: f32,
    },
    /// Go on at another speed \[m/s\].
    Speed(f32),
    /// Fly home and land.
    Return,
    /// Land where the drone is.
    Land,
}

/// A ground station that speaks to one vehicle.
#[derive(Debug)]
pub struct GroundStation {
    encoder: Encoder,
    vehicle: u8,
    origin: Home,
    now_secs: f64,
    next_heartbeat_secs: f64,
    plan: Vec<MISSION_ITEM_INT_DATA>,
    upload: Upload,
    texts: Vec<StatusText>,
}

/// Words of the vehicle.
#[derive(Clone, Debug, PartialEq)]
pub struct StatusText {
    /// When they were heard \[s\].
    pub secs: f64,
    /// What it said.
    pub text: String,
}

/// How far an upload is.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Upload {
    /// There is none, or the vehicle asks for its items.
    Answered,
    /// Begun then \[s\].
    Begun(f64),
}

impl GroundStation {
    /// A ground station for the vehicle with this system number, in a world whose origin is at `origin`.
    pub fn new(vehicle: u8, origin: Home) -> Self {
        let [system, component] = STATION;
        Self {
            encoder: Encoder::new(system, component),
            vehicle,
            origin,
            now_secs: 0.0,
            next_heartbeat_secs: 0.0,
            plan: Vec::new(),
            upload: Upload::Answered,
            texts: Vec::new(),
        }
    }

    /// What the vehicle said so far.
    pub fn texts(&self) -> &[StatusText] {
        &self.texts
    }

    /// Lets it be `now_secs` \[s, simulated\], and sends what is due: heartbeats, and an upload that nobody has answered.
    pub fn advance(&mut self, now_secs: f64, send: &mut dyn FnMut(&[u8])) {
        self.now_secs = now_secs;
        if now_secs >= self.next_heartbeat_secs {
            self.next_heartbeat_secs += HEARTBEAT_SECS;
            let mavtype = MavType::MAV_TYPE_GCS;
            let autopilot = MavAutopilot::MAV_AUTOPILOT_INVALID;
            self.send(&HEARTBEAT_DATA { mavtype, autopilot, mavlink_version: 3, ..HEARTBEAT_DATA::DEFAULT }, send);
        }
        if let Upload::Begun(begun_secs) = self.upload
            && now_secs - begun_secs >= UPLOAD_SECS
        {
            self.begin_upload(send);
        }
    }

    /// Sends an order.
    pub fn order(&mut self, order: &StationOrder, send: &mut dyn FnMut(&[u8])) {
        match order {
            StationOrder::Arm => self.command(MavCmd::MAV_CMD_COMPONENT_ARM_DISARM, [1.0, 0.0, 0.0], send),
            StationOrder::Disarm => self.command(MavCmd::MAV_CMD_COMPONENT_ARM_DISARM, [0.0; 3], send),
            StationOrder::StopMotors => self.command(MavCmd::MAV_CMD_DO_FLIGHTTERMINATION, [1.0, 0.0, 0.0], send),
            StationOrder::TakeOff(height_m) => self.take_off(height_m.unwrap_or(f32::NAN), send),
            StationOrder::Position { point, heading } => self.position(point, *heading, send),
            StationOrder::Velocity { velocity, yaw_rate } => self.velocity(velocity, *yaw_rate, send),
            StationOrder::Mode(mode) => {
                self.command(MavCmd::MAV_CMD_DO_SET_MODE, [1.0, mode.custom_mode() as f32, 0.0], send);
            }
            StationOrder::Interval(message_id, secs) => {
                let (message_id, micros) = (*message_id as f32, 1e6 * secs);
                self.command(MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL, [message_id, micros, 0.0], send);
            }
            StationOrder::Speed(speed) => self.command(MavCmd::MAV_CMD_DO_CHANGE_SPEED, [1.0, *speed, -1.0], send),
            StationOrder::Upload(items) => {
                self.plan = (0..).zip(items).map(|(sequence, item)| self.item(sequence, item)).collect();
                self.begin_upload(send);
            }
        }
    }

    /// Takes in what the vehicle sent, and answers what it asks for.
    pub fn hear(&mut self, datagram: &[u8], send: &mut dyn FnMut(&[u8])) {
        for frame in Frames::new(datagram).flatten().filter(|frame| READ.contains(&frame.message_id)) {
            let Ok(message) = MavMessage::parse(MavlinkVersion::V2, frame.message_id, frame.payload) else {
                continue;
            };
            self.handle(&message, send);
        }
    }

    #[expect(clippy::wildcard_enum_match_arm, reason = "a message is one of the dialect's hundreds")]
    #[expect(deprecated, reason = "vehicles may still send them")]
    fn handle(&mut self, message: &MavMessage, send: &mut dyn FnMut(&[u8])) {
        match message {
            MavMessage::STATUSTEXT(status) => {
                let text = status.text.to_str().unwrap_or_default().to_owned();
                self.texts.push(StatusText { secs: self.now_secs, text });
            }
            MavMessage::MISSION_REQUEST(request) => self.send_item(request.seq, send),
            MavMessage::MISSION_REQUEST_INT(request) => self.send_item(request.seq, send),
            MavMessage::MISSION_ACK(_) => self.upload = Upload::Answered,
            _ => {}
        }
    }

    fn send_item(&mut self, sequence: u16, send: &mut dyn FnMut(&[u8])) {
        self.upload = Upload::Answered;
        if let Some(item) = self.plan.get(usize::from(sequence)).cloned() {
            self.send(&item, send);
        }
    }

    fn begin_upload(&mut self, send: &mut dyn FnMut(&[u8])) {
        self.upload = Upload::Begun(self.now_secs);
        let count = self.plan.len() as u16;
        self.send(&MISSION_COUNT_DATA { count, target_system: self.vehicle, target_component: 1 }, send);
    }

    fn send(&mut self, message: &impl MessageData, send: &mut dyn FnMut(&[u8])) {
        send(&self.encoder.encode(&Payload::of(message)));
    }

    fn command(&mut self, command: MavCmd, parameters: [f32; 3], send: &mut dyn FnMut(&[u8])) {
        let [param1, param2, param3] = parameters;
        self.send(&COMMAND_LONG_DATA { param1, param2, param3, ..self.nothing(command) }, send);
    }

    fn take_off(&mut self, param7: f32, send: &mut dyn FnMut(&[u8])) {
        let open = f32::NAN;
        let nothing = self.nothing(MavCmd::MAV_CMD_NAV_TAKEOFF);
        self.send(&COMMAND_LONG_DATA { param5: open, param6: open, param7, ..nothing }, send);
    }

    /// A command whose parameters are zero.
    fn nothing(&self, command: MavCmd) -> COMMAND_LONG_DATA {
        COMMAND_LONG_DATA {
            command,
            target_system: self.vehicle,
            target_component: 1,
            ..COMMAND_LONG_DATA::DEFAULT
        }
    }

    fn position(&mut self, point: &Vector3<f32>, heading: Option<f32>, send: &mut dyn FnMut(&[u8])) {
        let [x, y, z] = ned_from_enu(point);
        let yaw = heading.map_or(0.0, |heading| FRAC_PI_2 - heading);
        let ignored = NO_VELOCITY | if heading.is_some() { 0 } else { NO_YAW };
        let set_point = self.set_point(ignored | NO_YAW_RATE);
        self.send(&SET_POSITION_TARGET_LOCAL_NED_DATA { x, y, z, yaw, ..set_point }, send);
    }

    fn velocity(&mut self, velocity: &Vector3<f32>, yaw_rate: Option<f32>, send: &mut dyn FnMut(&[u8])) {
        let [vx, vy, vz] = ned_from_enu(velocity);
        let ignored = NO_POSITION | NO_YAW | if yaw_rate.is_some() { 0 } else { NO_YAW_RATE };
        let yaw_rate = yaw_rate.map_or(0.0, |rate| -rate);
        let set_point = self.set_point(ignored);
        self.send(&SET_POSITION_TARGET_LOCAL_NED_DATA { vx, vy, vz, yaw_rate, ..set_point }, send);
    }

    fn set_point(&self, ignored: u16) -> SET_POSITION_TARGET_LOCAL_NED_DATA {
        SET_POSITION_TARGET_LOCAL_NED_DATA {
            type_mask: PositionTargetTypemask::from_bits_truncate(ignored | NO_ACCELERATION),
            target_system: self.vehicle,
            target_component: 1,
            coordinate_frame: MavFrame::MAV_FRAME_LOCAL_NED,
            time_boot_ms: (self.now_secs * 1e3) as u32,
            ..SET_POSITION_TARGET_LOCAL_NED_DATA::DEFAULT
        }
    }

    /// As QGroundControl has it: places on Earth, heights above home.
    fn item(&self, seq: u16, item: &PlanItem) -> MISSION_ITEM_INT_DATA {
        let here = MISSION_ITEM_INT_DATA {
            seq,
            frame: MavFrame::MAV_FRAME_GLOBAL_RELATIVE_ALT,
            x: i32::MAX,
            y: i32::MAX,
            param4: f32::NAN,
            autocontinue: 1,
            target_system: self.vehicle,
            target_component: 1,
            ..MISSION_ITEM_INT_DATA::DEFAULT
        };
        match *item {
            PlanItem::TakeOff(z) => MISSION_ITEM_INT_DATA { command: MavCmd::MAV_CMD_NAV_TAKEOFF, z, ..here },
            PlanItem::Waypoint { point, hold_secs: param1 } => {
                let [x, y] = self.origin.place_of(&point).integers();
                let command = MavCmd::MAV_CMD_NAV_WAYPOINT;
                MISSION_ITEM_INT_DATA { command, param1, x, y, z: point.z, ..here }
            }
            PlanItem::Speed(param2) => {
                let command = MavCmd::MAV_CMD_DO_CHANGE_SPEED;
                MISSION_ITEM_INT_DATA { command, param1: 1.0, param2, ..here }
            }
            PlanItem::Return => {
                let command = MavCmd::MAV_CMD_NAV_RETURN_TO_LAUNCH;
                MISSION_ITEM_INT_DATA { command, ..here }
            }
            PlanItem::Land => MISSION_ITEM_INT_DATA { command: MavCmd::MAV_CMD_NAV_LAND, ..here },
        }
    }
}

#[cfg(test)]
mod tests {
    use std::mem;

    use kestrel_core::airframe::CF2X;
    use kestrel_core::pilot::Pilot;

    use super::*;
    use crate::autopilot::Mode;
    use crate::controller::Controller;
    use crate::link::{EndpointId, Peer};
    use crate::plant::{FlatFloor, Plant};
    use crate::testing::{hover_policy, pilot, profile};
    use crate::vehicle::Vehicle;

    const STATION: Peer = Peer { link: 0, endpoint: EndpointId::ONLY };

    /// A vehicle that hears a ground station.
    struct Pair {
        station: GroundStation,
        vehicle: Vehicle<Pilot<'static>>,
        plant: FlatFloor,
        /// What the station has not heard yet.
        said: Vec<Vec<u8>>,
    }

    impl Pair {
        fn new() -> Self {
            let vehicle = Vehicle::new(pilot(hover_policy()), &CF2X, profile(1));
            let plant = FlatFloor::new(&CF2X, vehicle.control_period().as_secs_f32());
            let station = GroundStation::new(1, Home::default());
            let mut pair = Self { station, vehicle, plant, said: Vec::new() };
            pair.fly(0.1);
            pair
        }

        /// Has the station speak to the vehicle.
        fn speak(&mut self, speak: impl FnOnce(&mut GroundStation, &mut dyn FnMut(&[u8]))) {
            let Self { station, vehicle, said, .. } = self;
            speak(station, &mut |bytes| {
                assert!(vehicle.receive(STATION, bytes, &mut |frame| said.push(frame.to_vec())));
            });
        }

        fn order(&mut self, order: &StationOrder) {
            self.speak(|station, send| station.order(order, send));
        }

        fn fly(&mut self, secs: f32) {
            for _ in 0..(secs / self.vehicle.control_period().as_secs_f32()).round() as u32 {
                let now_secs = self.vehicle.elapsed_secs();
                self.speak(|station, send| station.advance(now_secs, send));
                let Self { vehicle, plant, said, .. } = self;
                let targets = vehicle.tick(plant.state(), &[STATION], &mut |_, frame| said.push(frame.to_vec()));
                plant.step(&targets);
                for frame in mem::take(&mut self.said) {
                    self.speak(|station, send| station.hear(&frame, send));
                }
            }
        }
    }

    fn texts(station: &GroundStation) -> Vec<&str> {
        station.texts().iter().map(|said| said.text.as_str()).collect()
    }

    #[test]
    fn a_flight_by_orders_ends_where_it_was_sent_and_is_told_about() {
        let mut pair = Pair::new();
        pair.order(&StationOrder::Arm);
        pair.order(&StationOrder::TakeOff(Some(0.8)));
        pair.fly(5.0);
        assert_eq!(pair.vehicle.mode(), Mode::Holding);
        let point = Vector3::new(1.0, 0.5, 1.2);
        pair.order(&StationOrder::Position { point, heading: None });
        pair.fly(12.0);
        assert!((pair.plant.state().position - point).norm() < 0.1, "{}", pair.plant.state().position);
        pair.order(&StationOrder::Mode(FlightMode::Land));
        pair.fly(10.0);
        assert_eq!(texts(&pair.station), ["take-off complete", "landed", "disarmed"]);
    }

    #[test]
    fn a_mission_is_uploaded_item_by_item_and_flown() {
        let mut pair = Pair::new();
        let corner = PlanItem::Waypoint { point: Vector3::new(1.0, 0.0, 1.0), hold_secs: 1.0 };
        let items = vec![PlanItem::TakeOff(1.0), PlanItem::Speed(0.6), corner, PlanItem::Land];
        // The beginning is lost: it is sent again.
        pair.station.order(&StationOrder::Upload(items), &mut |_| {});
        pair.fly(2.0);
        pair.order(&StationOrder::Arm);
        pair.order(&StationOrder::Mode(FlightMode::Mission));
        pair.fly(25.0);
        let position = pair.plant.state().position;
        assert!((position - Vector3::new(1.0, 0.0, 0.0)).norm() < 0.25, "{position}");
        assert_eq!(pair.vehicle.mode(), Mode::Disarmed, "{:?}", texts(&pair.station));
    }

    #[test]
    fn velocities_headings_and_controllers_are_what_was_ordered() {
        let mut pair = Pair::new();
        pair.order(&StationOrder::Mode(FlightMode::Cascade));
        assert_eq!(pair.vehicle.active_controller(), Controller::Cascade);
        pair.order(&StationOrder::Arm);
        pair.order(&StationOrder::TakeOff(None));
        pair.fly(6.0);
        let point = Vector3::new(0.0, 0.0, 1.0);
        pair.order(&StationOrder::Position { point, heading: Some(1.0) });
        pair.fly(6.0);
        let yaw = crate::steering::yaw(&pair.plant.state().world_from_body);
        assert!((yaw - 1.0).abs() < 0.05, "{yaw}");
        for _ in 0..20 {
            pair.order(&StationOrder::Velocity { velocity: Vector3::new(0.0, 0.4, 0.0), yaw_rate: None });
            pair.order(&StationOrder::Mode(FlightMode::Offboard));
            pair.fly(0.1);
        }
        let velocity = pair.plant.state().velocity;
        assert!((velocity - Vector3::new(0.0, 0.4, 0.0)).norm() < 0.15, "{velocity}");
        pair.order(&StationOrder::StopMotors);
        assert_eq!(pair.vehicle.mode(), Mode::Disarmed);
    }
}
