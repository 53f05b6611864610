//! What the vehicle tells again and again, stream by stream.

use kestrel_core::airframe::GRAVITY;
use kestrel_core::vehicle::State;
use nalgebra::Vector3;

use super::{Punctuality, Vehicle};
use crate::frame::Payload;
use crate::link::Peer;
use crate::message::sent::{motion, status, surroundings};
use crate::policy_backend::PolicyBackend;
use crate::telemetry::TelemetryStream;

/// Messages of one stream at one time: what the policy is has ten.
const MESSAGES: usize = 10;

impl<P: PolicyBackend> Vehicle<P> {
    /// Sends a stream to everybody to whom it is due.
    pub(super) fn publish(
        &mut self,
        stream: TelemetryStream,
        state: &State<f32>,
        send: &mut dyn FnMut(Peer, &[u8]),
    ) {
        let payloads = self.payloads(stream, state);
        let tick = self.controller.ticks();
        for channel in self.channels.due(stream, tick) {
            for payload in &payloads {
                send(channel.peer, &self.controller.encode_numbered(payload, &mut channel.sequence));
            }
        }
    }

    /// What the policy is (its hash), how old its last answer is, how long the last tick took, how the flight keeps its pace,
    /// and what share of its thrust each rotor makes, where that is learned.
    fn policy_report(&self) -> heapless::Vec<Payload, MESSAGES> {
        let time = self.time_boot_ms();
        let [a, b, c, d, ..] = self.profile.policy.hash;
        let policy = [
            status::named_float("RL_AGE_MS", self.autopilot().silent_secs() * 1e3, time),
            status::named_float("RL_LAT_MS", self.latency_secs * 1e3, time),
            status::named_integer("RL_HASH", i32::from_be_bytes([a, b, c, d]), time),
        ];
        let pace = self.punctuality.map(|Punctuality { real_time_factor, late_secs, overruns }| {
            [
                status::named_float("RL_RTF", real_time_factor, time),
                status::named_float("RL_LATE_MS", late_secs * 1e3, time),
                status::named_integer("RL_OVERRUN", i32::try_from(overruns).unwrap_or(i32::MAX), time),
            ]
        });
        let rotors = self.autopilot().settings().compensates_rotors.then(|| {
            let [first, second, third, fourth] = self.autopilot().rotor_shares();
            [("RL_ROTOR1", first), ("RL_ROTOR2", second), ("RL_ROTOR3", third), ("RL_ROTOR4", fourth)]
                .map(|(name, share)| status::named_float(name, share, time))
        });
        policy.into_iter().chain(pace.into_iter().flatten()).chain(rotors.into_iter().flatten()).collect()
    }

    /// What a stream tells now: most are of one message.
    fn payloads(&mut self, stream: TelemetryStream, state: &State<f32>) -> heapless::Vec<Payload, MESSAGES> {
        let time_boot_ms = self.time_boot_ms();
        let time_usec = self.time_usec();
        let origin = &self.profile.origin;
        let personality = self.profile.personality;
        let flight_mode = personality.told(self.flight_mode());
        let payload = match stream {
            TelemetryStream::Heartbeat => status::heartbeat(self.mode(), flight_mode, personality),
            TelemetryStream::SysStatus => status::sys_status(&self.health(state)),
            TelemetryStream::ExtendedSysState => status::extended_sys_state(self.mode()),
            TelemetryStream::CurrentMode => status::current_mode(flight_mode, personality),
            TelemetryStream::Policy => return self.policy_report(),
            TelemetryStream::DistanceSensor => {
                let told = |ranges| surroundings::distance_sensors(ranges, time_boot_ms);
                return self.ranges.iter().flat_map(told).collect();
            }
            TelemetryStream::ObstacleDistance => {
                let told = |ranges| surroundings::obstacle_distance(ranges, time_usec);
                return self.ranges.iter().map(told).collect();
            }
            TelemetryStream::EventSequence => return self.event_sequence().into_iter().collect(),
            TelemetryStream::ControlStatus => self.control_status(),
            TelemetryStream::LocalPositionCov => {
                motion::local_position_ned_cov(state, &self.acceleration, time_usec)
            }
            TelemetryStream::AttitudeTarget => {
                motion::attitude_target(self.autopilot().attitude_set_point(), time_boot_ms)
            }
            TelemetryStream::MissionCurrent => self.mission_current(),
            TelemetryStream::BatteryStatus => status::battery_status(&self.battery),
            TelemetryStream::HomePosition => motion::home_position(self.autopilot().home(), origin),
            TelemetryStream::Altitude => motion::altitude(state, origin, time_usec),
            TelemetryStream::GpsRawInt => motion::gps_raw_int(state, origin, time_usec),
            TelemetryStream::VfrHud => motion::vfr_hud(state, origin, self.throttle()),
            TelemetryStream::ServoOutputRaw => motion::servo_output_raw(self.rotor_shares(), time_usec as u32),
            TelemetryStream::PositionTarget => motion::position_target(self.autopilot().goal(), time_boot_ms),
            TelemetryStream::GlobalPosition => motion::global_position_int(state, origin, time_boot_ms),
            TelemetryStream::Odometry => motion::odometry(state, time_usec),
            TelemetryStream::HighresImu => motion::highres_imu(state, &self.specific_force(state), time_usec),
            TelemetryStream::EscStatus => motion::esc_status(&state.rotor_speeds, time_usec),
            TelemetryStream::EstimatorStatus => motion::estimator_status(time_usec),
            TelemetryStream::AttitudeQuaternion => motion::attitude_quaternion(state, time_boot_ms),
            TelemetryStream::Attitude => motion::attitude(state, time_boot_ms),
            TelemetryStream::LocalPosition => motion::local_position_ned(state, time_boot_ms),
        };
        [payload].into_iter().collect()
    }

    /// What an inertial unit felt then \[m/s²\], in the drone's axes.
    fn specific_force(&self, state: &State<f32>) -> Vector3<f32> {
        state.world_from_body.rotate_inverse(self.acceleration + Vector3::z() * GRAVITY as f32)
    }

    fn health(&mut self, state: &State<f32>) -> status::VehicleHealth {
        status::VehicleHealth {
            policy: self.controller.autopilot_mut().healthy(),
            inside_fence: self.autopilot().margin_m(&state.position) >= 0.0,
            battery: self.battery,
            garbage: self.counts().garbage,
            refused: self.counts().refused,
        }
    }

    fn time_usec(&self) -> u64 {
        (self.elapsed_secs() * 1e6) as u64
    }

    pub(super) fn time_boot_ms(&self) -> u32 {
        (self.elapsed_secs() * 1e3) as u32
    }

    /// Rotor targets as shares of the greatest speed.
    fn rotor_shares(&self) -> [f32; 4] {
        self.rotor_targets.map(|target| target / self.rotor_speed_limit)
    }

    fn throttle(&self) -> f32 {
        self.rotor_shares().iter().sum::<f32>() / 4.0
    }
}
