//! What a camera tells of itself and of its video stream.

use crate::frame::Payload;

/// `CAMERA_CAP_FLAGS_HAS_VIDEO_STREAM`, `VIDEO_STREAM_STATUS_FLAGS_RUNNING`, `VIDEO_STREAM_TYPE_RTSP`,
/// `VIDEO_STREAM_ENCODING_H264` and `CAMERA_MODE_VIDEO`.
const HAS_VIDEO_STREAM: u32 = 256;
const RUNNING: u16 = 1;
const RTSP: u8 = 0;
const H264: u8 = 1;
const VIDEO_MODE: u8 = 1;

/// The only stream has this number.
pub const STREAM: u8 = 1;

/// Bytes of names and of the address of the stream.
const NAME_LEN: usize = 32;
const URI_LEN: usize = 160;

/// A camera and its video stream.
#[derive(Clone, Debug, PartialEq)]
pub struct CameraProfile {
    /// Where the stream is, such as `rtsp://127.0.0.1:8554/camera`.
    pub url: String,
    /// Columns and rows of its pictures \[px\].
    pub size: [u16; 2],
    /// Pictures a second.
    pub rate_hz: f32,
    /// Angle of view, across \[degrees\].
    pub view_angle_deg: u16,
}

/// `HEARTBEAT` of a camera that works.
pub fn heartbeat() -> Payload {
    /// `MAV_TYPE_CAMERA`, `MAV_AUTOPILOT_INVALID`, no mode, `MAV_STATE_ACTIVE`, and the version of MAVLink.
    const CAMERA: [u8; 5] = [30, 8, 0, 4, 3];
    let fields = [0; 4].into_iter().chain(CAMERA).collect::<heapless::Vec<u8, 9>>();
    Payload::new(0, 50, &fields)
}

/// `CAMERA_INFORMATION`; lens and sensor are ideal, and have no sizes.
pub fn information(camera: &CameraProfile, time_boot_ms: u32) -> Payload {
    let unknown = f32::NAN.to_le_bytes();
    let numbers = [time_boot_ms.to_le_bytes(), [0; 4], unknown, unknown, unknown, HAS_VIDEO_STREAM.to_le_bytes()];
    let [columns, rows] = camera.size;
    let fields = numbers
        .into_iter()
        .flatten()
        .chain([columns, rows, 0].into_iter().flat_map(u16::to_le_bytes))
        .chain(padded::<NAME_LEN>("Kestrel"))
        .chain(padded::<NAME_LEN>("on board"))
        // One lens, and no definition file.
        .chain([0, 0]);
    Payload::new(259, 92, &fields.collect::<heapless::Vec<u8, 235>>())
}

/// `VIDEO_STREAM_INFORMATION`.
pub fn stream_information(camera: &CameraProfile) -> Payload {
    let fields = numbers(camera)
        .chain([STREAM, STREAM, RTSP])
        .chain(padded::<NAME_LEN>("on board"))
        .chain(padded::<URI_LEN>(&camera.url))
        .chain([H264]);
    Payload::new(269, 109, &fields.collect::<heapless::Vec<u8, 214>>())
}

/// `VIDEO_STREAM_STATUS`.
pub fn stream_status(camera: &CameraProfile) -> Payload {
    let fields = numbers(camera).chain([STREAM]);
    Payload::new(270, 59, &fields.collect::<heapless::Vec<u8, 19>>())
}

/// `CAMERA_SETTINGS`: it takes videos, and zooms nothing.
pub fn settings(time_boot_ms: u32) -> Payload {
    let unknown = f32::NAN.to_le_bytes();
    let fields = time_boot_ms.to_le_bytes().into_iter().chain([VIDEO_MODE]).chain(unknown).chain(unknown);
    Payload::new(260, 146, &fields.collect::<heapless::Vec<u8, 13>>())
}

/// `STORAGE_INFORMATION`: there is no storage.
pub fn storage(time_boot_ms: u32) -> Payload {
    /// `STORAGE_STATUS_NOT_SUPPORTED`.
    const NOT_SUPPORTED: u8 = 3;
    // Capacities and speeds of none, its number, and how many there are.
    let fields = time_boot_ms.to_le_bytes().into_iter().chain([0; 22]).chain([NOT_SUPPORTED]);
    Payload::new(261, 179, &fields.collect::<heapless::Vec<u8, 27>>())
}

/// `CAMERA_CAPTURE_STATUS`: it stores nothing.
pub fn capture_status(time_boot_ms: u32) -> Payload {
    let fields = time_boot_ms.to_le_bytes().into_iter().chain([0; 14]);
    Payload::new(262, 12, &fields.collect::<heapless::Vec<u8, 18>>())
}

/// What information and status of a stream begin with; the bit rate is not known before.
fn numbers(camera: &CameraProfile) -> impl Iterator<Item = u8> {
    let ([columns, rows], rotation) = (camera.size, 0);
    let words = [RUNNING, columns, rows, rotation, camera.view_angle_deg];
    camera.rate_hz.to_le_bytes().into_iter().chain([0; 4]).chain(words.into_iter().flat_map(u16::to_le_bytes))
}

/// A text of so many bytes, cut or filled with zeros.
fn padded<const LEN: usize>(text: &str) -> impl Iterator<Item = u8> {
    let mut bytes = [0; LEN];
    bytes.iter_mut().zip(text.bytes()).for_each(|(byte, letter)| *byte = letter);
    bytes.into_iter()
}
