//! Pictures to H.264, in 4:2:0 by BT.601, which players take for granted.

use rusty_h264_common::YuvFrame;
use rusty_h264_encoder::{Encoder, EncoderConfig, Preset};

use crate::picture::{Picture, Rgb};

/// Size of the blocks of which levels allow a number \[px\].
const BLOCK: usize = 16;

/// Levels with their greatest number of blocks, 25 pictures a second (H.264, table A-1).
const LEVELS: [(u8, usize); 5] = [(30, 1620), (31, 3600), (40, 8192), (50, 22_080), (51, 36_864)];

/// How coarse: 0 is the best, 51 the smallest.
const QUANTISATION: u8 = 28;

/// Pictures from one that can be jumped to, to the next.
const KEY_EVERY: u32 = 100;

/// Kinds of units (H.264, table 7-1): sequence and picture parameter set.
const SEQUENCE_PARAMETERS: u8 = 7;
const PICTURE_PARAMETERS: u8 = 8;

/// The least level with pictures of a size, if there is one.
pub(crate) fn level(size: [usize; 2]) -> Option<u8> {
    let [across, down] = size.map(|pixels| pixels.div_ceil(BLOCK));
    let fits = |blocks: usize| across * down <= blocks && across.max(down).pow(2) <= 8 * blocks;
    LEVELS.iter().find(|(_, blocks)| fits(*blocks)).map(|(level, _)| *level)
}

/// How carefully pictures are encoded.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Effort {
    /// For files.
    Thorough,
    /// While something is flown.
    Live,
}

/// Why a picture is not encoded, in the encoder's words.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("cannot encode the picture as H.264: {0}")]
pub struct EncodingError(String);

/// Encodes one picture after the other.
pub struct H264Encoder(Encoder);

impl H264Encoder {
    /// For pictures of a size \[px\], so many a second; nothing when H.264 has none so large.
    ///
    /// # Errors
    /// When the encoder refuses.
    pub fn new(size: [usize; 2], rate_hz: f32, effort: Effort) -> Result<Option<Self>, EncodingError> {
        let Some(level_idc) = level(size) else { return Ok(None) };
        let [width, height] = even(size);
        let config = EncoderConfig {
            level_idc,
            qp: QUANTISATION,
            preset: match effort {
                Effort::Thorough => Preset::Balanced,
                Effort::Live => Preset::Fast,
            },
            gop_size: KEY_EVERY,
            framerate: rate_hz,
            // A picture in, a picture out.
            mbtree: false,
            ..EncoderConfig::new(width, height)
        };
        Encoder::new(config).map(|encoder| Some(Self(encoder))).map_err(|reason| failed(&reason))
    }

    /// The access unit of a picture, in Annex B.
    ///
    /// # Errors
    /// When the encoder fails.
    pub fn encode(&mut self, picture: &Picture) -> Result<Vec<u8>, EncodingError> {
        self.encode_frame(&frame(picture))
    }

    pub(crate) fn encode_frame(&mut self, frame: &YuvFrame) -> Result<Vec<u8>, EncodingError> {
        self.0.try_encode(frame).map_err(|reason| failed(&reason))
    }

    /// The next picture can be jumped to.
    pub fn request_key(&mut self) {
        self.0.request_keyframe();
    }
}

fn failed(reason: &impl ToString) -> EncodingError {
    EncodingError(reason.to_string())
}

/// Sequence and picture parameter set of an access unit in Annex B, without their start codes.
pub fn parameter_sets(access_unit: &[u8]) -> [Vec<u8>; 2] {
    [SEQUENCE_PARAMETERS, PICTURE_PARAMETERS].map(|kind| {
        let found = units(access_unit).find(|unit| unit.first().is_some_and(|head| head & 0x1F == kind));
        found.unwrap_or_default().to_vec()
    })
}

/// The units between start codes of three or four bytes.
fn units(access_unit: &[u8]) -> impl Iterator<Item = &[u8]> {
    let starts: Vec<usize> = access_unit
        .windows(3)
        .enumerate()
        .filter(|(_, three)| *three == [0, 0, 1])
        .map(|(place, _)| place + 3)
        .collect();
    let ends: Vec<usize> = starts.iter().skip(1).map(|next| next - 3).chain([access_unit.len()]).collect();
    starts.into_iter().zip(ends).map(|(start, end)| {
        let unit = access_unit.get(start..end).unwrap_or_default();
        // The first zero of a start code of four bytes is not the unit's.
        unit.strip_suffix(&[0]).unwrap_or(unit)
    })
}

/// Colours are of two by two pixels.
pub(crate) fn even(size: [usize; 2]) -> [usize; 2] {
    size.map(|pixels| pixels.next_multiple_of(2))
}

/// A picture as the encoder takes it; an odd last column or row is doubled.
pub(crate) fn frame(picture: &Picture) -> YuvFrame {
    let [width, height] = even(picture.size);
    let [columns, rows] = picture.size;
    let at = |column: usize, row: usize| picture.pixels[row.min(rows - 1) * columns + column.min(columns - 1)];
    let luma = (0..height).flat_map(|row| (0..width).map(move |column| luma(at(column, row))));
    let corners = || (0..height).step_by(2).flat_map(|row| (0..width).step_by(2).map(move |column| [column, row]));
    let mean = |[column, row]: [usize; 2]| {
        let four = [at(column, row), at(column + 1, row), at(column, row + 1), at(column + 1, row + 1)];
        [0, 1, 2].map(|part| 0.25 * four.iter().map(|pixel| f32::from(pixel[part])).sum::<f32>())
    };
    YuvFrame {
        width,
        height,
        y: luma.collect(),
        u: corners().map(|corner| chroma(mean(corner), [-0.148_22, -0.290_99, 0.439_22])).collect(),
        v: corners().map(|corner| chroma(mean(corner), [0.439_22, -0.367_79, -0.071_43])).collect(),
    }
}

/// 16 is black, 235 white.
fn luma([red, green, blue]: Rgb) -> u8 {
    let [red, green, blue] = [red, green, blue].map(f32::from);
    (16.0 + 0.256_79 * red + 0.504_13 * green + 0.097_91 * blue).round() as u8
}

/// 128 is grey.
fn chroma(colour: [f32; 3], weights: [f32; 3]) -> u8 {
    let sum: f32 = colour.iter().zip(weights).map(|(part, weight)| part * weight).sum();
    (128.0 + sum).round() as u8
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_stream_begins_with_its_parameters_and_can_be_jumped_to() {
        let picture = Picture::new([65, 48], [200, 10, 30]);
        let mut encoder = H264Encoder::new(picture.size, 25.0, Effort::Live).unwrap().unwrap();
        let kinds = |unit: &[u8]| units(unit).map(|unit| unit[0] & 0x1F).collect::<Vec<u8>>();
        let first = encoder.encode(&picture).unwrap();
        assert_eq!(kinds(&first), [7, 8, 5], "parameters and a key picture");
        let [sequence, picture_set] = parameter_sets(&first);
        assert_eq!((sequence[0] & 0x1F, picture_set[0] & 0x1F), (7, 8));
        let second = encoder.encode(&picture).unwrap();
        assert_eq!(kinds(&second), [1]);
        assert!(parameter_sets(&second).iter().all(Vec::is_empty));
        encoder.request_key();
        assert!(kinds(&encoder.encode(&picture).unwrap()).contains(&5));
        assert!(H264Encoder::new([1 << 20, 16], 25.0, Effort::Live).unwrap().is_none());
    }
}
