//! Pictures to MP4: H.264 in 4:2:0 by BT.601, which players take for granted.

use muxide::api::{Muxer, MuxerBuilder, VideoCodec};
use rusty_h264_common::YuvFrame;
use rusty_h264_encoder::{Encoder, EncoderConfig, Preset};

use super::playback::PICTURE_SECS;
use super::{VideoError, VideoFormat};
use crate::picture::{Picture, Rgb};

/// Size of the blocks of which levels allow a number \[px\].
const BLOCK: usize = 16;

/// Levels with their greatest number of blocks, 25 pictures a second (H.264, table A-1).
const LEVELS: [(u8, usize); 5] = [(30, 1620), (31, 3600), (40, 8192), (50, 22_080), (51, 36_864)];

/// How coarse: 0 is the best, 51 the smallest.
const QUANTISATION: u8 = 28;

/// Pictures from one that can be jumped to, to the next.
const KEY_EVERY: u32 = 100;

/// The least level with pictures of a size, if there is one.
pub(crate) fn level(size: [usize; 2]) -> Option<u8> {
    let [across, down] = size.map(|pixels| pixels.div_ceil(BLOCK));
    let fits = |blocks: usize| across * down <= blocks && across.max(down).pow(2) <= 8 * blocks;
    LEVELS.iter().find(|(_, blocks)| fits(*blocks)).map(|(level, _)| *level)
}

/// A video in the making.
pub(crate) struct Writer {
    encoder: Encoder,
    muxer: Muxer<Vec<u8>>,
    pictures: u32,
}

impl Writer {
    pub(crate) fn new(size: [usize; 2]) -> Result<Self, VideoError> {
        let too_large = VideoError::Size { format: VideoFormat::Mp4, size };
        let level_idc = level(size).ok_or(too_large)?;
        let [width, height] = even(size);
        let framerate = PICTURE_SECS.recip();
        let config = EncoderConfig {
            level_idc,
            qp: QUANTISATION,
            preset: Preset::Balanced,
            gop_size: KEY_EVERY,
            framerate,
            // A picture in, a picture out.
            mbtree: false,
            ..EncoderConfig::new(width, height)
        };
        let muxer = MuxerBuilder::new(Vec::new())
            .video(VideoCodec::H264, width as u32, height as u32, f64::from(framerate))
            .with_fast_start(true)
            .build();
        Ok(Self { encoder: Encoder::new(config).map_err(failed)?, muxer: muxer.map_err(failed)?, pictures: 0 })
    }

    /// Adds a picture.
    pub(crate) fn push(&mut self, frame: &YuvFrame) -> Result<(), VideoError> {
        let encoded = self.encoder.try_encode(frame).map_err(failed)?;
        let secs = f64::from(self.pictures) * f64::from(PICTURE_SECS);
        let key = muxide::codec::h264::is_h264_keyframe(&encoded);
        self.pictures += 1;
        self.muxer.write_video(secs, &encoded, key).map_err(failed)
    }

    pub(crate) fn finish(mut self) -> Result<Vec<u8>, VideoError> {
        self.muxer.finish_in_place().map_err(failed)?;
        Ok(self.muxer.into_writer())
    }
}

fn failed(reason: impl std::fmt::Display) -> VideoError {
    VideoFormat::Mp4.failed(&reason)
}

/// Colours are of two by two pixels.
fn even(size: [usize; 2]) -> [usize; 2] {
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
