//! Recorded flights as ROS 2 messages in an MCAP file, for whoever looks at robots: Foxglove, rerun, `PlotJuggler`,
//! `ros2 bag`. No ROS is needed to write one, and the same recording gives the same bytes.
//!
//! | topic | message | |
//! |---|---|---|
//! | `/tf` | `tf2_msgs/TFMessage` | `world` to `drone0`, its camera, and each body that moves |
//! | `/world` | `visualization_msgs/MarkerArray` | floor, solids, movables, drones |
//! | `/drone0/odom` | `nav_msgs/Odometry` | true pose in `world`, true twist in `drone0` |
//! | `/drone0/twist` | `geometry_msgs/TwistStamped` | true velocity in `world`, body rates turned into it |
//! | `/drone0/imu` | `sensor_msgs/Imu` | attitude, body rates, specific force: mean over the control period before |
//! | `/drone0/rotors` | `sensor_msgs/JointState` | rotor speeds \[rad/s\] as velocities |
//! | `/drone0/action` | `std_msgs/Float64MultiArray` | what the pilot commanded |
//! | `/drone0/goal` | `geometry_msgs/PoseStamped` | where it should go |
//! | `/drone0/range/front` … | `sensor_msgs/Range` | ideal rangers along the body's axes, up to 4 m; only what never moves |
//! | `/drone0/camera/image`, `…/camera_info` | `sensor_msgs/Image`, `sensor_msgs/CameraInfo` | the camera on board, 10 a second |
//! | `/drone0/reward/NAME` | `std_msgs/Float64` | what each term paid for the step that began there |
//! | `/drone0/outcome` | `std_msgs/String` | how it ended, once |
//!
//! Frames are those of ROS (REP 103): x forward, y left, z up; optical frames z forward, x right, y down. A flight begins
//! one second after time zero, which tf takes for "the latest".

mod bag;
mod definition;
mod flight;
mod marker;
mod message;
#[cfg(feature = "node")]
pub mod node;
pub mod rangers;
#[cfg(test)]
mod tests;

pub use flight::mcap;

/// Why there is no file.
#[derive(Debug, thiserror::Error)]
pub enum RosError {
    /// The recording cannot be shown.
    #[error(transparent)]
    Recording(#[from] kestrel_experiments::recording::RecordingError),
    /// Its flight cannot be seen.
    #[error(transparent)]
    Video(#[from] kestrel_draw::video::VideoError),
    /// The file's format takes no more.
    #[error("cannot write MCAP: {0}")]
    Mcap(#[from] ::mcap::McapError),
    /// A message cannot be encoded.
    #[error("cannot encode a message: {0}")]
    Encoding(#[from] cdr_encoding::Error),
}
