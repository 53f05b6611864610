//! Writing policy files, into the caller's bytes: the one definition of the format beside its reader.

use super::header::{CHECKSUM_LEN, FrontSizes, Header, Sections, collected};
use super::metadata::{action_identifier, layout_identifier};
use super::{FORMAT_VERSION, HEADER_LEN, Network, ParameterFormat, PolicyError, PolicyMetadata, PolicyScratch};
use crate::crc32::crc32;
use crate::fixed::FixedFormat;
use crate::limits::{ACTION_LIMIT, LAYER_LIMIT};
use crate::mlp::{DenseLayer, hidden_activation};

/// What goes into a policy file. The golden actions are computed while it is written.
#[derive(Clone, Copy, Debug)]
pub struct PolicyDraft<'a> {
    /// What the firmware must know.
    pub metadata: PolicyMetadata<'a>,
    /// How the parameters are stored.
    pub parameters: ParameterFormat,
    /// From the observation to the action.
    pub layers: &'a [DenseLayer<'a>],
    /// Observations of the golden vectors, one after the other, 1 to [`super::GOLDEN_LIMIT`] of them.
    pub golden_observations: &'a [f32],
}

impl PolicyDraft<'_> {
    /// Bytes of the file.
    ///
    /// # Errors
    /// The variant of whatever no policy file can hold.
    pub fn file_len(&self) -> Result<usize, PolicyError> {
        Ok(self.header(0)?.sections(FrontSizes::default()).checksum.end)
    }

    /// Writes the file to the start of `bytes`, which start on a four-byte boundary of memory, and returns its length; the
    /// same draft gives the same bytes.
    ///
    /// # Errors
    /// The variant of whatever no policy file can hold, [`PolicyError::Misaligned`] or [`PolicyError::BufferTooSmall`].
    pub fn write(&self, bytes: &mut [u8]) -> Result<usize, PolicyError> {
        let header = self.header(0)?;
        let (file, sections) = self.write_parts(&header, FrontSizes::default(), FORMAT_VERSION, bytes)?;
        self.write_actions(&header, &sections, file)?;
        Ok(seal(file))
    }

    /// Writes the golden observations, and the actions that the network in the file gives for them.
    fn write_actions(&self, header: &Header, sections: &Sections, file: &mut [u8]) -> Result<(), PolicyError> {
        let (front, parameters) = file.split_at_mut_checked(sections.parameters.start).unwrap_or_default();
        let parameters = parameters.get(..sections.parameters.len()).unwrap_or_default();
        let network = Network::from_parameters(header, 0, parameters)?;
        let mut scratch = PolicyScratch::new();
        let act = |observation: &[f32], _: &[u8]| Ok(network.act(observation, &mut scratch));
        self.write_golden(header, &[], section(front, sections.golden.clone()), act)
    }

    /// Writes header, metadata and parameters; returns the whole file and where its sections are.
    pub(super) fn write_parts<'b>(
        &self,
        header: &Header,
        encoder: FrontSizes,
        version: u16,
        bytes: &'b mut [u8],
    ) -> Result<(&'b mut [u8], Sections), PolicyError> {
        let sections = header.sections(encoder);
        let (found, expected) = (bytes.len(), sections.checksum.end);
        let file = bytes.get_mut(..expected).ok_or(PolicyError::BufferTooSmall { found, expected })?;
        file.fill(0);
        copy(&header.encode(version, expected), section(file, 0..HEADER_LEN));
        self.write_metadata(section(file, sections.metadata.clone()))?;
        self.write_parameters(section(file, sections.parameters.clone()))?;
        Ok((file, sections))
    }

    /// The header of a policy whose first layer reads `features` values behind the observation.
    pub(super) fn header(&self, features: usize) -> Result<Header, PolicyError> {
        self.metadata.check()?;
        self.check_shapes(features)?;
        let expected = self.metadata.observation.len();
        let found = self.golden_observations.len();
        if found == 0 || !found.is_multiple_of(expected) {
            return Err(PolicyError::GoldenObservations { found, expected });
        }
        let header = Header {
            parameters: self.canonical_parameters(),
            activation: hidden_activation(self.layers),
            observation_layout: layout_identifier(&self.metadata.observation),
            action_space: action_identifier(&self.metadata.action),
            metadata_len: metadata_len(&self.metadata)?,
            golden_vectors: found / expected,
            widths: collected(self.widths().map(|width| width.min(usize::from(u16::MAX)) as u16)),
        };
        header.check()?;
        Ok(header)
    }

    fn widths(&self) -> impl Iterator<Item = usize> + '_ {
        core::iter::once(self.metadata.observation.len()).chain(self.layers.iter().map(|layer| layer.outputs))
    }

    fn check_shapes(&self, features: usize) -> Result<(), PolicyError> {
        if !(1..=LAYER_LIMIT).contains(&self.layers.len()) {
            return Err(PolicyError::LayerCount { found: self.layers.len() });
        }
        let expected_inputs = self.metadata.observation.len() + features;
        let found = self.layers.first().map_or(0, |layer| layer.inputs);
        if found != expected_inputs {
            return Err(PolicyError::ObservationLength { found, expected: expected_inputs });
        }
        let (found, expected) = (self.layers.last().map_or(0, |layer| layer.outputs), self.metadata.action.len());
        if found != expected {
            return Err(PolicyError::ActionLength { found, expected });
        }
        for (index, (layer, inputs)) in self.layers.iter().zip(self.widths()).enumerate() {
            let inputs = if index == 0 { expected_inputs } else { inputs };
            if !layer.is_complete() || layer.inputs != inputs {
                return Err(layer_shape(index, layer, inputs));
            }
            let (found, expected) = (layer.activation, hidden_activation(self.layers));
            if index + 1 < self.layers.len() && found != expected {
                return Err(PolicyError::MixedActivations { layer: index, found, expected });
            }
        }
        Ok(())
    }

    /// Fraction bits of layers that do not exist are stored as zero.
    fn canonical_parameters(&self) -> ParameterFormat {
        let ParameterFormat::Fixed16(mut format) = self.parameters else { return self.parameters };
        for bits in format.weight_fraction_bits.iter_mut().skip(self.layers.len()) {
            *bits = 0;
        }
        format.activation = hidden_activation(self.layers);
        ParameterFormat::Fixed16(format)
    }

    fn write_metadata(&self, bytes: &mut [u8]) -> Result<(), PolicyError> {
        let found = bytes.len();
        let too_long = |_| PolicyError::Metadata { found };
        let written = match &self.metadata.airframe {
            None => postcard::to_slice(&self.metadata, bytes),
            Some(airframe) => postcard::to_slice(&(&self.metadata, airframe), bytes),
        };
        written.map(|_| ()).map_err(too_long)
    }

    fn write_parameters(&self, mut bytes: &mut [u8]) -> Result<(), PolicyError> {
        let parameters = self.canonical_parameters();
        for (index, layer) in self.layers.iter().enumerate() {
            bytes = match &parameters {
                ParameterFormat::Float32 => copy_words(layer.packed().map(f32::to_le_bytes), bytes),
                ParameterFormat::Fixed16(format) => write_layer(layer, *format, index, bytes)?,
            };
        }
        Ok(())
    }

    /// Writes the observations, the actions that the network in the file gives for them, and an image for each of them,
    /// if there are any.
    pub(super) fn write_golden(
        &self,
        header: &Header,
        images: &[u8],
        golden: &mut [u8],
        mut act: impl FnMut(&[f32], &[u8]) -> Result<[f32; ACTION_LIMIT], PolicyError>,
    ) -> Result<(), PolicyError> {
        let (observation_len, image_len) = (header.observation_len(), images.len() / header.golden_vectors.max(1));
        let vectors = golden.chunks_exact_mut(header.golden_bytes(image_len).max(4));
        let observations = self.golden_observations.chunks_exact(observation_len);
        for (index, (bytes, observation)) in vectors.zip(observations).enumerate() {
            let image = images.get(index * image_len..(index + 1) * image_len).unwrap_or_default();
            let rest = copy_words(observation.iter().map(|value| value.to_le_bytes()), bytes);
            let action = act(observation, image)?;
            let action = action.iter().take(header.action_len()).map(|value| value.to_le_bytes());
            copy(image, copy_words(action, rest));
        }
        Ok(())
    }
}

/// Writes a layer that stands where number `index` of a network does, and returns what follows it.
pub(super) fn write_layer<'b>(
    layer: &DenseLayer<'_>,
    format: FixedFormat,
    index: usize,
    bytes: &'b mut [u8],
) -> Result<&'b mut [u8], PolicyError> {
    let sum_bits = format.sum_fraction_bits(index)?;
    let weight_bits = format.weight_fraction_bits.get(index).copied().unwrap_or_default();
    if !layer.fits(format, index) {
        return Err(PolicyError::WeightsTooLarge { layer: index });
    }
    let rest = copy_words(layer.fixed_biases(sum_bits).map(i32::to_le_bytes), bytes);
    Ok(copy_words(layer.fixed_weights(weight_bits).map(i16::to_le_bytes), rest))
}

fn layer_shape(index: usize, layer: &DenseLayer<'_>, inputs: usize) -> PolicyError {
    let (weights, biases, outputs) = (layer.weights.len(), layer.bias.len(), layer.outputs);
    PolicyError::LayerShape { layer: index, weights, biases, inputs, outputs }
}

fn metadata_len(metadata: &PolicyMetadata<'_>) -> Result<usize, PolicyError> {
    let size = postcard::ser_flavors::Size::default();
    let counted = match &metadata.airframe {
        None => postcard::serialize_with_flavor(metadata, size),
        Some(airframe) => postcard::serialize_with_flavor(&(metadata, airframe), size),
    };
    counted.map_err(|_| PolicyError::Metadata { found: 0 })
}

/// Writes the checksum behind everything else of `file` and returns its length.
pub(super) fn seal(file: &mut [u8]) -> usize {
    let len = file.len();
    let (contents, checksum) = file.split_at_mut_checked(len.saturating_sub(CHECKSUM_LEN)).unwrap_or_default();
    copy(&crc32(contents).to_le_bytes(), checksum);
    len
}

pub(super) fn section(bytes: &mut [u8], range: core::ops::Range<usize>) -> &mut [u8] {
    bytes.get_mut(range).unwrap_or_default()
}

pub(super) fn copy(source: &[u8], destination: &mut [u8]) {
    for (slot, byte) in destination.iter_mut().zip(source) {
        *slot = *byte;
    }
}

/// Copies `words` to the start of `bytes` and returns what follows them.
pub(super) fn copy_words<const N: usize>(words: impl Iterator<Item = [u8; N]>, bytes: &mut [u8]) -> &mut [u8] {
    let mut rest = bytes;
    for word in words {
        match rest.split_first_chunk_mut::<N>() {
            Some((slot, following)) => {
                *slot = word;
                rest = following;
            }
            None => return &mut [],
        }
    }
    rest
}
