//! ROS 2 messages, field by field in the order in which they are encoded.
//!
//! Lengths are in metres, angles in radians; quaternions are x, y, z, w there. Covariances are zero, which means unknown.

use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

/// A message that has a topic of its own.
pub(crate) trait Message: Serialize {
    /// Package and name, such as `nav_msgs/Odometry`.
    const NAME: &'static str;
}

macro_rules! messages {
    ($($message:ty: $name:literal),+ $(,)?) => {
        $(impl Message for $message {
            const NAME: &'static str = $name;
        })+
    };
}
#[cfg(feature = "node")]
pub(crate) use messages;

messages! {
    CameraInfo: "sensor_msgs/CameraInfo",
    Float64: "std_msgs/Float64",
    Float64MultiArray: "std_msgs/Float64MultiArray",
    Image: "sensor_msgs/Image",
    Imu: "sensor_msgs/Imu",
    JointState: "sensor_msgs/JointState",
    MarkerArray: "visualization_msgs/MarkerArray",
    Odometry: "nav_msgs/Odometry",
    PoseStamped: "geometry_msgs/PoseStamped",
    Range: "sensor_msgs/Range",
    Text: "std_msgs/String",
    TransformTree: "tf2_msgs/TFMessage",
    TwistStamped: "geometry_msgs/TwistStamped",
}

#[derive(Clone, Copy, Debug, Default, Serialize, Deserialize)]
pub(crate) struct Time {
    pub(crate) sec: i32,
    pub(crate) nanosec: u32,
}

#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub(crate) struct Header {
    pub(crate) stamp: Time,
    pub(crate) frame_id: String,
}

#[derive(Clone, Copy, Debug, Default, Serialize, Deserialize)]
pub(crate) struct Triple {
    pub(crate) x: f64,
    pub(crate) y: f64,
    pub(crate) z: f64,
}

#[derive(Clone, Copy, Debug, Default, Serialize)]
pub(crate) struct Quaternion {
    pub(crate) x: f64,
    pub(crate) y: f64,
    pub(crate) z: f64,
    pub(crate) w: f64,
}

/// A pose, and a transform between two frames, which has the same fields.
#[derive(Clone, Copy, Debug, Default, Serialize)]
pub(crate) struct Pose {
    pub(crate) position: Triple,
    pub(crate) orientation: Quaternion,
}

#[derive(Clone, Debug, Serialize)]
pub(crate) struct Transform {
    pub(crate) header: Header,
    pub(crate) child_frame_id: String,
    pub(crate) pose: Pose,
}

#[derive(Clone, Debug, Serialize)]
pub(crate) struct TransformTree {
    pub(crate) transforms: Vec<Transform>,
}

#[derive(Clone, Debug, Serialize)]
pub(crate) struct PoseStamped {
    pub(crate) header: Header,
    pub(crate) pose: Pose,
}

#[derive(Clone, Copy, Debug, Default, Serialize, Deserialize)]
pub(crate) struct Twist {
    pub(crate) linear: Triple,
    pub(crate) angular: Triple,
}

#[derive(Clone, Debug, Serialize)]
pub(crate) struct TwistStamped {
    pub(crate) header: Header,
    pub(crate) twist: Twist,
}

#[derive(Clone, Copy, Debug, Default, Serialize)]
pub(crate) struct WithCovariance<T> {
    pub(crate) value: T,
    pub(crate) covariance: [[f64; 6]; 6],
}

#[derive(Clone, Debug, Serialize)]
pub(crate) struct Odometry {
    pub(crate) header: Header,
    pub(crate) child_frame_id: String,
    pub(crate) pose: WithCovariance<Pose>,
    pub(crate) twist: WithCovariance<Twist>,
}

#[derive(Clone, Debug, Serialize)]
pub(crate) struct Imu {
    pub(crate) header: Header,
    pub(crate) orientation: Quaternion,
    pub(crate) orientation_covariance: [f64; 9],
    pub(crate) angular_velocity: Triple,
    pub(crate) angular_velocity_covariance: [f64; 9],
    pub(crate) linear_acceleration: Triple,
    pub(crate) linear_acceleration_covariance: [f64; 9],
}

#[derive(Clone, Debug, Serialize)]
#[expect(clippy::struct_field_names, reason = "they are those of ROS 2")]
pub(crate) struct Range {
    pub(crate) header: Header,
    pub(crate) radiation_type: u8,
    pub(crate) field_of_view: f32,
    pub(crate) min_range: f32,
    pub(crate) max_range: f32,
    pub(crate) range: f32,
    pub(crate) variance: f32,
}

#[derive(Clone, Debug, Serialize)]
pub(crate) struct JointState {
    pub(crate) header: Header,
    pub(crate) name: Vec<String>,
    pub(crate) position: Vec<f64>,
    pub(crate) velocity: Vec<f64>,
    pub(crate) effort: Vec<f64>,
}

#[derive(Clone, Copy, Debug, Serialize)]
pub(crate) struct Float64 {
    pub(crate) data: f64,
}

#[derive(Clone, Debug, Serialize)]
pub(crate) struct ArrayDimension {
    pub(crate) label: String,
    pub(crate) size: u32,
    pub(crate) stride: u32,
}

#[derive(Clone, Debug, Serialize)]
pub(crate) struct Float64MultiArray {
    pub(crate) dimensions: Vec<ArrayDimension>,
    pub(crate) data_offset: u32,
    pub(crate) data: Vec<f64>,
}

#[derive(Clone, Debug, Serialize)]
pub(crate) struct Text {
    pub(crate) data: String,
}

#[derive(Clone, Debug, Serialize)]
pub(crate) struct Image {
    pub(crate) header: Header,
    pub(crate) height: u32,
    pub(crate) width: u32,
    pub(crate) encoding: String,
    pub(crate) is_bigendian: u8,
    pub(crate) step: u32,
    pub(crate) data: Vec<u8>,
}

#[derive(Clone, Debug, Serialize)]
pub(crate) struct CameraInfo {
    pub(crate) header: Header,
    pub(crate) height: u32,
    pub(crate) width: u32,
    pub(crate) distortion_model: String,
    pub(crate) d: Vec<f64>,
    pub(crate) k: [f64; 9],
    pub(crate) r: [f64; 9],
    pub(crate) p: [f64; 12],
    pub(crate) binning_x: u32,
    pub(crate) binning_y: u32,
    pub(crate) region_of_interest: RegionOfInterest,
}

#[derive(Clone, Copy, Debug, Default, Serialize)]
pub(crate) struct RegionOfInterest {
    pub(crate) x_offset: u32,
    pub(crate) y_offset: u32,
    pub(crate) height: u32,
    pub(crate) width: u32,
    pub(crate) do_rectify: bool,
}

#[derive(Clone, Copy, Debug, Default, Serialize)]
pub(crate) struct Colour {
    pub(crate) r: f32,
    pub(crate) g: f32,
    pub(crate) b: f32,
    pub(crate) a: f32,
}

#[derive(Clone, Debug, Default, Serialize)]
pub(crate) struct CompressedImage {
    pub(crate) header: Header,
    pub(crate) format: String,
    pub(crate) data: Vec<u8>,
}

#[derive(Clone, Debug, Default, Serialize)]
pub(crate) struct MeshFile {
    pub(crate) filename: String,
    pub(crate) data: Vec<u8>,
}

/// Something to look at. What ours leave empty stands behind [`Self::colours`].
#[derive(Clone, Debug, Default, Serialize)]
pub(crate) struct Marker {
    pub(crate) header: Header,
    pub(crate) namespace: String,
    pub(crate) id: i32,
    pub(crate) kind: i32,
    pub(crate) action: i32,
    pub(crate) pose: Pose,
    pub(crate) scale: Triple,
    pub(crate) colour: Colour,
    pub(crate) lifetime: Time,
    pub(crate) frame_locked: bool,
    pub(crate) points: Vec<Triple>,
    pub(crate) colours: Vec<Colour>,
    pub(crate) texture_resource: String,
    pub(crate) texture: CompressedImage,
    pub(crate) texture_coordinates: Vec<[f32; 2]>,
    pub(crate) text: String,
    pub(crate) mesh_resource: String,
    pub(crate) mesh_file: MeshFile,
    pub(crate) mesh_use_embedded_materials: bool,
}

#[derive(Clone, Debug, Serialize)]
pub(crate) struct MarkerArray {
    pub(crate) markers: Vec<Marker>,
}

impl Header {
    pub(crate) fn new(stamp: Time, frame_id: &str) -> Self {
        Self { stamp, frame_id: frame_id.to_owned() }
    }
}

impl Time {
    /// Of a time, or a duration \[s\].
    pub(crate) fn of(secs: f64) -> Self {
        let nanoseconds = (secs * 1e9).round() as u64;
        Self { sec: (nanoseconds / 1_000_000_000) as i32, nanosec: (nanoseconds % 1_000_000_000) as u32 }
    }

    /// \[s\].
    #[cfg(feature = "node")]
    pub(crate) fn secs(self) -> f32 {
        self.sec as f32 + 1e-9 * self.nanosec as f32
    }
}

#[cfg(feature = "node")]
impl Triple {
    pub(crate) fn vector(self) -> Vector3<f32> {
        Vector3::new(self.x, self.y, self.z).cast()
    }
}

impl From<Vector3<f64>> for Triple {
    fn from(vector: Vector3<f64>) -> Self {
        Self { x: vector.x, y: vector.y, z: vector.z }
    }
}

impl From<[f64; 3]> for Triple {
    fn from([x, y, z]: [f64; 3]) -> Self {
        Self { x, y, z }
    }
}
