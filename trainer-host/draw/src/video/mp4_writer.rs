//! Pictures to MP4.

use muxide::api::{Muxer, MuxerBuilder, VideoCodec};
use rusty_h264_common::YuvFrame;

use super::h264::{Effort, H264Encoder, even};
use super::playback::PICTURE_SECS;
use super::{VideoError, VideoFormat};

/// A video in the making.
pub(crate) struct Writer {
    encoder: H264Encoder,
    muxer: Muxer<Vec<u8>>,
    pictures: u32,
}

impl Writer {
    pub(crate) fn new(size: [usize; 2]) -> Result<Self, VideoError> {
        let too_large = VideoError::Size { format: VideoFormat::Mp4, size };
        let rate_hz = PICTURE_SECS.recip();
        let encoder = H264Encoder::new(size, rate_hz, Effort::Thorough).map_err(failed)?.ok_or(too_large)?;
        let [width, height] = even(size);
        let muxer = MuxerBuilder::new(Vec::new())
            .video(VideoCodec::H264, width as u32, height as u32, f64::from(rate_hz))
            .with_fast_start(true)
            .build();
        Ok(Self { encoder, muxer: muxer.map_err(failed)?, pictures: 0 })
    }

    /// Adds a picture.
    pub(crate) fn push(&mut self, frame: &YuvFrame) -> Result<(), VideoError> {
        let encoded = self.encoder.encode_frame(frame).map_err(failed)?;
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
