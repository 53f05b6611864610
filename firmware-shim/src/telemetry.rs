//! Which message is due when, in control ticks.

/// Messages that are sent again and again.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TelemetryStream {
    /// `HEARTBEAT`, 1 Hz.
    Heartbeat,
    /// `SYS_STATUS`, 1 Hz.
    SysStatus,
    /// `EXTENDED_SYS_STATE`, 2 Hz.
    ExtendedSysState,
    /// `CURRENT_MODE`, every 2 s.
    CurrentMode,
    /// `MISSION_CURRENT`, 1 Hz.
    MissionCurrent,
    /// `BATTERY_STATUS`, every 2 s.
    BatteryStatus,
    /// `HOME_POSITION`, every 2 s.
    HomePosition,
    /// `ALTITUDE`, 1 Hz.
    Altitude,
    /// `GPS_RAW_INT`, 5 Hz.
    GpsRawInt,
    /// `VFR_HUD`, 4 Hz.
    VfrHud,
    /// `SERVO_OUTPUT_RAW`, 10 Hz.
    ServoOutputRaw,
    /// `POSITION_TARGET_LOCAL_NED`, 10 Hz.
    PositionTarget,
    /// `GLOBAL_POSITION_INT`, 10 Hz.
    GlobalPosition,
    /// `ODOMETRY`, 25 Hz.
    Odometry,
    /// `HIGHRES_IMU`, 10 Hz.
    HighresImu,
    /// `DISTANCE_SENSOR` of each ranger, 5 Hz.
    DistanceSensor,
    /// `OBSTACLE_DISTANCE` around the drone, as far as its rangers see, 5 Hz.
    ObstacleDistance,
    /// `ESC_STATUS`, on request: pymavlink's usual dialect does not know it.
    EscStatus,
    /// `ESTIMATOR_STATUS`, 1 Hz.
    EstimatorStatus,
    /// `LOCAL_POSITION_NED_COV`, on request: all of it is in `LOCAL_POSITION_NED` and `HIGHRES_IMU`.
    LocalPositionCov,
    /// `ATTITUDE_TARGET`, 2 Hz.
    AttitudeTarget,
    /// `ATTITUDE_QUATERNION`, 50 Hz.
    AttitudeQuaternion,
    /// `ATTITUDE`, 50 Hz.
    Attitude,
    /// `LOCAL_POSITION_NED`, 50 Hz.
    LocalPosition,
    /// `CURRENT_EVENT_SEQUENCE`, 1 Hz once something has happened.
    EventSequence,
    /// `CONTROL_STATUS`, 1 Hz once several clients have spoken.
    ControlStatus,
    /// What the policy is and how fast it answers, as `NAMED_VALUE_FLOAT` and `NAMED_VALUE_INT`, 1 Hz.
    Policy,
}

/// No interval \[s\].
const NEVER: f32 = -1.0;

impl TelemetryStream {
    /// All of them, in the order in which they are sent.
    pub const ALL: [Self; 27] = [
        Self::Heartbeat,
        Self::SysStatus,
        Self::ExtendedSysState,
        Self::CurrentMode,
        Self::MissionCurrent,
        Self::BatteryStatus,
        Self::HomePosition,
        Self::Altitude,
        Self::GpsRawInt,
        Self::VfrHud,
        Self::ServoOutputRaw,
        Self::PositionTarget,
        Self::GlobalPosition,
        Self::Odometry,
        Self::HighresImu,
        Self::DistanceSensor,
        Self::ObstacleDistance,
        Self::EscStatus,
        Self::EstimatorStatus,
        Self::LocalPositionCov,
        Self::AttitudeTarget,
        Self::AttitudeQuaternion,
        Self::Attitude,
        Self::LocalPosition,
        Self::EventSequence,
        Self::ControlStatus,
        Self::Policy,
    ];

    /// The stream of a message, if it is one.
    pub fn of_message(message_id: u32) -> Option<Self> {
        Self::ALL.into_iter().find(|stream| stream.message_id() == message_id)
    }

    const fn message_id(self) -> u32 {
        match self {
            Self::Heartbeat => 0,
            Self::SysStatus => 1,
            Self::GpsRawInt => 24,
            Self::Attitude => 30,
            Self::AttitudeQuaternion => 31,
            Self::LocalPosition => 32,
            Self::GlobalPosition => 33,
            Self::ServoOutputRaw => 36,
            Self::MissionCurrent => 42,
            Self::LocalPositionCov => 64,
            Self::VfrHud => 74,
            Self::AttitudeTarget => 83,
            Self::PositionTarget => 85,
            Self::HighresImu => 105,
            Self::DistanceSensor => 132,
            Self::Altitude => 141,
            Self::BatteryStatus => 147,
            Self::EstimatorStatus => 230,
            Self::HomePosition => 242,
            Self::ExtendedSysState => 245,
            Self::Policy => 251,
            Self::EscStatus => 291,
            Self::ObstacleDistance => 330,
            Self::Odometry => 331,
            Self::EventSequence => 411,
            Self::CurrentMode => 436,
            Self::ControlStatus => 512,
        }
    }

    const fn default_secs(self) -> f32 {
        match self {
            Self::CurrentMode | Self::BatteryStatus | Self::HomePosition => 2.0,
            Self::Heartbeat
            | Self::SysStatus
            | Self::MissionCurrent
            | Self::Altitude
            | Self::EstimatorStatus
            | Self::EventSequence
            | Self::ControlStatus
            | Self::Policy => 1.0,
            Self::ExtendedSysState | Self::AttitudeTarget => 0.5,
            Self::EscStatus | Self::LocalPositionCov => NEVER,
            Self::VfrHud => 0.25,
            Self::GpsRawInt | Self::DistanceSensor | Self::ObstacleDistance => 0.2,
            Self::ServoOutputRaw | Self::PositionTarget | Self::GlobalPosition | Self::HighresImu => 0.1,
            Self::Odometry => 0.04,
            Self::AttitudeQuaternion | Self::Attitude | Self::LocalPosition => 0.02,
        }
    }
}

/// Intervals of the streams; simulated time, so that a run repeats itself.
#[derive(Clone, Debug)]
pub struct TelemetrySchedule {
    control_secs: f32,
    intervals_ticks: [Option<u64>; TelemetryStream::ALL.len()],
}

impl TelemetrySchedule {
    /// The default intervals, for ticks of `control_secs`.
    pub fn new(control_secs: f32) -> Self {
        let mut schedule = Self { control_secs, intervals_ticks: [None; TelemetryStream::ALL.len()] };
        for stream in TelemetryStream::ALL {
            schedule.set_interval(stream, stream.default_secs());
        }
        schedule
    }

    /// Sends a stream every `secs`, at most once per tick; as by default if zero, never if negative or NaN.
    pub fn set_interval(&mut self, stream: TelemetryStream, secs: f32) {
        let secs = if secs == 0.0 { stream.default_secs() } else { secs };
        let ticks = (secs / self.control_secs).round().max(1.0) as u64;
        self.intervals_ticks[stream as usize] = (secs > 0.0).then_some(ticks);
    }

    /// Time between two messages of a stream \[s\]; none if it is never sent.
    pub fn interval_secs(&self, stream: TelemetryStream) -> Option<f32> {
        self.intervals_ticks[stream as usize].map(|ticks| ticks as f32 * self.control_secs)
    }

    /// Whether a stream is due at a tick.
    pub fn due(&self, stream: TelemetryStream, tick: u64) -> bool {
        self.intervals_ticks[stream as usize].is_some_and(|interval| tick.is_multiple_of(interval))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn in_ten_secs(schedule: &TelemetrySchedule, stream: TelemetryStream) -> usize {
        (0..1000).filter(|&tick| schedule.due(stream, tick)).count()
    }

    #[test]
    fn default_rates_hold_in_simulated_time() {
        let schedule = TelemetrySchedule::new(0.01);
        let counts = TelemetryStream::ALL.map(|stream| in_ten_secs(&schedule, stream));
        assert_eq!(
            counts,
            [
                10, 10, 20, 5, 10, 5, 5, 10, 50, 40, 100, 100, 100, 250, 100, 50, 50, 0, 10, 0, 20, 500, 500, 500,
                10, 10, 10
            ]
        );
    }

    #[test]
    fn intervals_are_set_reset_and_switched_off() {
        let mut schedule = TelemetrySchedule::new(0.01);
        let mut count = |secs| {
            schedule.set_interval(TelemetryStream::Attitude, secs);
            in_ten_secs(&schedule, TelemetryStream::Attitude)
        };
        assert_eq!(count(0.1), 100);
        assert_eq!(count(1e-6), 1000, "once per tick at most");
        assert_eq!(count(-1.0), 0);
        assert_eq!(count(f32::NAN), 0);
        assert_eq!(count(0.0), 500);
        assert_eq!(count(f32::INFINITY), 1, "at the first tick only");
    }

    #[test]
    fn streams_are_found_by_their_message() {
        for stream in TelemetryStream::ALL {
            assert_eq!(TelemetryStream::of_message(stream.message_id()), Some(stream));
        }
        assert_eq!(TelemetryStream::of_message(148), None);
    }
}
