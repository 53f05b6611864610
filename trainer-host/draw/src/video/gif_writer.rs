//! Pictures to GIF.

use std::borrow::Cow;

use gif::{DisposalMethod, Encoder, EncodingError, Frame, Repeat};

/// How long the last picture of a video stays before it starts again \[s\].
pub(crate) const PAUSE_SECS: f32 = 1.5;

/// What all pictures of a video have in common.
#[derive(Clone, Debug)]
pub(crate) struct Format {
    /// Columns and rows.
    pub(crate) size: [usize; 2],
    /// Red, green, blue of each colour.
    pub(crate) palette: Vec<u8>,
    /// The colour that leaves a pixel as it was in the picture before.
    pub(crate) unchanged: u8,
}

/// A video in the making, endlessly repeated.
pub(crate) struct Writer {
    format: Format,
    encoder: Encoder<Vec<u8>>,
    before: Option<Vec<u8>>,
}

impl Writer {
    pub(crate) fn new(format: Format) -> Result<Self, EncodingError> {
        let [columns, rows] = format.size.map(|pixels| pixels as u16);
        let mut encoder = Encoder::new(Vec::new(), columns, rows, &format.palette)?;
        encoder.set_repeat(Repeat::Infinite)?;
        Ok(Self { format, encoder, before: None })
    }

    /// Adds a picture, in indices of the palette, that is seen for `secs`.
    pub(crate) fn push(&mut self, picture: Vec<u8>, secs: f32) -> Result<(), EncodingError> {
        let mut frame = self.format.smallest(self.before.as_deref(), &picture);
        frame.delay = (secs * 100.0).round() as u16;
        self.before = Some(picture);
        self.encoder.write_lzw_pre_encoded_frame(&frame)
    }

    pub(crate) fn finish(self) -> Result<Vec<u8>, EncodingError> {
        self.encoder.into_inner()
    }
}

impl Format {
    /// The shortest way to write a picture over the one before.
    fn smallest(&self, before: Option<&[u8]>, picture: &[u8]) -> Frame<'static> {
        let Some(before) = before else {
            return encoded([0, 0, self.size[0], self.size[1]], picture.to_vec(), None);
        };
        let changed = self.changed_area(before, picture);
        let whole = self.crop(picture, changed);
        let differences = self
            .crop(before, changed)
            .into_iter()
            .zip(&whole)
            .map(|(old, &new)| if old == new { self.unchanged } else { new })
            .collect();
        let candidates = [encoded(changed, whole, None), encoded(changed, differences, Some(self.unchanged))];
        let [plain, sparse] = candidates;
        if sparse.buffer.len() < plain.buffer.len() { sparse } else { plain }
    }

    /// Smallest `[left, top, width, height]` that holds every changed pixel; one pixel when none has changed.
    fn changed_area(&self, before: &[u8], picture: &[u8]) -> [usize; 4] {
        let [width, _] = self.size;
        let changed = || (0..picture.len()).filter(|&pixel| before[pixel] != picture[pixel]);
        let columns = || changed().map(|pixel| pixel % width);
        let rows = || changed().map(|pixel| pixel / width);
        let (left, right) = (columns().min().unwrap_or(0), columns().max().unwrap_or(0));
        let (top, bottom) = (rows().min().unwrap_or(0), rows().max().unwrap_or(0));
        [left, top, right - left + 1, bottom - top + 1]
    }

    fn crop(&self, picture: &[u8], [left, top, width, height]: [usize; 4]) -> Vec<u8> {
        let rows = (top..top + height).map(|row| row * self.size[0] + left);
        rows.flat_map(|start| &picture[start..start + width]).copied().collect()
    }
}

fn encoded([left, top, width, height]: [usize; 4], pixels: Vec<u8>, transparent: Option<u8>) -> Frame<'static> {
    let mut frame = Frame {
        left: left as u16,
        top: top as u16,
        width: width as u16,
        height: height as u16,
        buffer: Cow::Owned(pixels),
        transparent,
        dispose: DisposalMethod::Keep,
        ..Frame::default()
    };
    frame.make_lzw_pre_encoded();
    frame
}
