//! C99 without a library of ours: header and source of a policy in fixed point.

use kestrel_core::fixed::{FixedFormat, HIDDEN_FRACTION_BITS, REQUANTISATION_SHIFT, SUM_FRACTION_BITS, TANGENTS};
use kestrel_core::policy_file::{Activation, ParameterFormat, PolicyAirframe, PolicyFile, RecurrentPolicy};

use super::{SourceError, comment, network_of, rows};
use crate::policy::Policy;

/// What is the same for every policy.
const CODE: &str = include_str!("policy.c.txt");

/// What a policy with a memory has before it acts.
const MEMORY: &str = include_str!("memory.c.txt");

/// Where acting begins, and what is otherwise there with a memory.
const ACT: &str = "void kestrel_act(const float";
const WITH_MEMORY: [(&str, &str); 6] = [
    (
        "kestrel_scratch *scratch,\n                 float action",
        "kestrel_scratch *scratch,\n                 kestrel_memory *memory, float action",
    ),
    (
        "    for (int layer = 0; layer < LAYERS",
        "    remember(scratch, memory->hidden);\n    for (int layer = 0; layer < LAYERS",
    ),
    (
        "    memcpy(&observation[index], &bits, sizeof bits);\n    kestrel_act(observation, scratch, action);",
        "    memcpy(&observation[index], &bits, sizeof bits);\n    kestrel_memory memory = {{0}};\n    kestrel_act(observation, scratch, &memory, action);",
    ),
    ("    for (int vector = 0;", "    kestrel_memory memory = {{0}};\n    for (int vector = 0;"),
    (
        "        kestrel_act(observation, scratch, action);",
        "        kestrel_act(observation, scratch, &memory, action);",
    ),
    (
        "/* Acts on a golden observation with one value of it replaced. */",
        "/* Acts on a golden observation with one value of it replaced, without a past. */",
    ),
];

/// Where the function of the tangent begins and ends in it.
const TANGENT: [&str; 2] = ["/* tanh in 2^-13", "/* Two products"];

/// In its place where rectifiers follow hidden layers.
const RECTIFIER: &str = "/* The sum in 2^-16 where it is positive, in 2^-11, halves upwards; within 16 bits. */
static int16_t rectified(int32_t sum) {
    int32_t limited = sum < 0 ? 0 : sum > 32767 << 5 ? 32767 << 5 : sum;
    return (int16_t)((limited + 16) >> 5);
}

";

/// Bytes behind the parameters in a policy file: the checksum.
const CHECKSUM_LEN: usize = 4;

/// Two files.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct CSource {
    /// `policy.h`.
    pub header: String,
    /// `policy.c`.
    pub source: String,
}

/// The C of the policy file `bytes`, which start on a four-byte boundary of memory.
///
/// # Errors
/// [`SourceError`].
pub fn c_source(bytes: &[u8]) -> Result<CSource, SourceError> {
    let policy = Policy::parse(bytes)?;
    policy.self_test()?;
    let (network, memory) = network_of(&policy)?;
    let ParameterFormat::Fixed16(format) = network.parameter_format() else { return Err(SourceError::Float) };
    if memory.is_some() && format.activation != Activation::Tanh {
        return Err(SourceError::RectifiedMemory);
    }
    Ok(CSource { header: header(network, memory), source: source(network, memory, format, bytes)? })
}

fn header(policy: &PolicyFile<'_>, memory: Option<&RecurrentPolicy<'_>>) -> String {
    let metadata = policy.metadata();
    let (name, period) = (comment(metadata.name), metadata.control_period_secs);
    let (observation, observation_len) = (metadata.observation.name(), metadata.observation.len());
    let (action, action_len) = (metadata.action.name(), metadata.action.len());
    let units = memory.map(RecurrentPolicy::units);
    // Gates have two rows for each unit.
    let width = widest(policy).max(units.map_or(0, |units| 2 * units));
    let remembered = units.map(memory_declaration).unwrap_or_default();
    let (argument, past) = match units {
        None => ("", ""),
        Some(_) => ("kestrel_memory *memory, ", ", after what the memory has of the flight"),
    };
    let airframe = metadata.airframe.as_ref().map(airframe_of).unwrap_or_default();
    format!(
        "/* The policy \"{name}\" in fixed point, written by `kestrel export --target c`.
 *
 * It sees {observation} and commands {action}; to be called every {period} s. Copy, as it is, into any C99 project whose
 * integers are two's complement and little-endian, and whose shifts of negative numbers keep the sign: every Cortex-M.
 */
#ifndef KESTREL_POLICY_H
#define KESTREL_POLICY_H

#include <stdint.h>

#ifdef __cplusplus
extern \"C\" {{
#endif

#define KESTREL_OBSERVATION_LEN {observation_len}
#define KESTREL_ACTION_LEN {action_len}
{airframe}
/* Working memory, of the caller's; contents do not matter between calls. */
typedef struct {{
    int32_t sums[{width}];
    int16_t activations[{width}];
}} kestrel_scratch;
{remembered}
/* The action in [-1, 1] on an encoded observation{past}; a NaN is read as zero. The same bits as kestrel-core. */
void kestrel_act(const float observation[KESTREL_OBSERVATION_LEN], kestrel_scratch *scratch,
                 {argument}float action[KESTREL_ACTION_LEN]);

/* 0 if an observation is finite, else the number of its first value that is not, from 1 on: what kestrel_guard() of
 * kestrel_guard.h takes as the code of a tick. */
int kestrel_refusal(const float observation[KESTREL_OBSERVATION_LEN]);

/* Computes the golden vectors of the export again, then inputs that are not finite, too large or too small: 0 if all bits are
 * equal, else the number of the first that is not. Before arming; do not fly on anything but 0. */
int kestrel_self_test(kestrel_scratch *scratch);

#ifdef __cplusplus
}}
#endif

#endif
"
    )
}

/// What a policy with so many units remembers.
fn memory_declaration(units: usize) -> String {
    format!(
        "
#define KESTREL_UNITS {units}

/* What the policy remembers of a flight: all zero at its start. */
typedef struct {{
    int16_t hidden[KESTREL_UNITS];
}} kestrel_memory;
"
    )
}

/// What makes newtons of its actions.
fn airframe_of(airframe: &PolicyAirframe) -> String {
    let PolicyAirframe { mass, rotor_thrust_limit, .. } = airframe;
    format!(
        "
/* The drone that it learned to fly: take-off mass [kg], greatest thrust of one rotor [N]. */
#define KESTREL_MASS_KG {mass:?}f
#define KESTREL_ROTOR_THRUST_LIMIT_N {rotor_thrust_limit:?}f
"
    )
}

fn widest(policy: &PolicyFile<'_>) -> usize {
    policy.shapes().map(|(inputs, outputs)| inputs.max(outputs).next_multiple_of(4)).max().unwrap_or_default()
}

fn source(
    policy: &PolicyFile<'_>,
    memory: Option<&RecurrentPolicy<'_>>,
    format: FixedFormat,
    bytes: &[u8],
) -> Result<String, SourceError> {
    // Those of the memory follow those of the network.
    let parameter_bytes = memory.map_or(policy.parameter_bytes(), RecurrentPolicy::parameter_bytes);
    let end = bytes.len() - CHECKSUM_LEN;
    let parameters = bytes[end - parameter_bytes..end].as_chunks::<4>().0;
    let words = |word: &[u8; 4]| format!("0x{:08x}", u32::from_le_bytes(*word));
    let (observation_len, action_len) = (policy.metadata().observation.len(), policy.metadata().action.len());
    let golden = policy.golden_vectors().flat_map(|(observation, action)| {
        let vector = [&observation[..observation_len], &action[..action_len]].concat();
        vector.into_iter().map(|value| format!("0x{:08x}", value.to_bits()))
    });
    let (layers, sum_bits) = layers(policy, format)?;
    let of_memory = memory.map(|memory| memory_constants(policy, memory, format)).transpose()?;
    let constants = format!(
        "#define INPUT_SCALE {input_scale}.0f
/* Bits of the least magnitude that is 32767 in fixed point. */
#define INPUT_LIMIT 0x{input_limit:08x}u
#define OUTPUT_SCALE (1.0f / {output_scale}.0f)
#define LAYERS {layer_count}
#define GOLDEN_VECTORS {vectors}
{of_memory}
/* Pairs of inputs, blocks of four rows, and the power of two that brings sums to 2^-16. */
static const struct {{ int pairs, blocks, shift; }} LAYER[LAYERS] = {{{layers}
}};

/* Layer by layer: biases, then weights as [block][pair][row], two to a word. */
static const uint32_t PARAMETERS[{parameter_count}] = {{{parameters}
}};

{tangents}/* Bits of the observations and of the actions on them. */
static const uint32_t GOLDEN[GOLDEN_VECTORS][KESTREL_OBSERVATION_LEN + KESTREL_ACTION_LEN] = {{{golden}
}};
",
        input_scale = 1_u32 << format.input_fraction_bits,
        input_limit = (32767.0 / (1_u32 << format.input_fraction_bits) as f32).to_bits(),
        output_scale = 1_u64 << sum_bits,
        layer_count = layers.len(),
        vectors = policy.golden_vectors().count(),
        of_memory = of_memory.unwrap_or_default(),
        parameter_count = parameters.len(),
        parameters = rows(parameters.iter().map(words), 8),
        tangents = match format.activation {
            Activation::Tanh => tangents(),
            Activation::Relu => String::new(),
        },
        golden = golden_rows(golden, observation_len + action_len),
        layers = rows(layers.iter().cloned(), 1),
    );
    let code = match (format.activation, memory) {
        (Activation::Tanh, None) => CODE.to_owned(),
        (Activation::Tanh, Some(_)) => remembering_code(CODE),
        (Activation::Relu, None | Some(_)) => rectified_code(),
    };
    Ok(code.replace("CONSTANTS\n", &constants))
}

/// Pairs, blocks and shift of each layer, and the fraction bits of the last sums.
fn layers(policy: &PolicyFile<'_>, format: FixedFormat) -> Result<(Vec<String>, u32), SourceError> {
    let mut layers = Vec::new();
    let mut sum_bits = 0;
    for (index, (inputs, outputs)) in policy.shapes().enumerate() {
        sum_bits = format.sum_fraction_bits(index)?;
        let shift = REQUANTISATION_SHIFT + SUM_FRACTION_BITS - sum_bits;
        layers.push(format!("{{{}, {}, {shift}}}", inputs.div_ceil(2), outputs.div_ceil(4)));
    }
    Ok((layers, sum_bits))
}

/// Where the memory's parameters are, and the powers of two that bring its sums to 2^-16.
fn memory_constants(
    network: &PolicyFile<'_>,
    memory: &RecurrentPolicy<'_>,
    format: FixedFormat,
) -> Result<String, SourceError> {
    let [gates, candidate] = memory.memory().weight_fraction_bits();
    let shift = |weights: u8| {
        let mut of_layer = format;
        of_layer.weight_fraction_bits[0] = weights;
        Ok::<_, SourceError>(REQUANTISATION_SHIFT + SUM_FRACTION_BITS - of_layer.sum_fraction_bits(0)?)
    };
    Ok(format!(
        "
/* Words before the memory's parameters, pairs of its inputs, powers of two that bring its sums to 2^-16, and what the hidden
 * state, in 2^-15, loses beside the observation. */
#define MEMORY_AT {at}
#define MEMORY_PAIRS {pairs}
#define GATE_SHIFT {gate}
#define CANDIDATE_SHIFT {candidate}
#define HIDDEN_SHIFT {hidden}
",
        at = network.parameter_bytes() / 4,
        pairs = (memory.metadata().observation.len() + memory.units()).div_ceil(2),
        gate = shift(gates)?,
        candidate = shift(candidate)?,
        hidden = HIDDEN_FRACTION_BITS - u32::from(format.input_fraction_bits),
    ))
}

/// The code with a memory before it acts.
fn remembering_code(code: &str) -> String {
    let at = code.find(ACT).expect("the code acts");
    let code = [&code[..at], MEMORY, &code[at..]].concat();
    WITH_MEMORY.iter().fold(code, |code, (from, to)| {
        assert!(code.contains(from), "the code has {from}");
        code.replacen(from, to, 1)
    })
}

/// The table of the tangent.
fn tangents() -> String {
    format!(
        "/* Of tanh: in the high half the value at the start of each 1/64, rounding included, in the low half what it grows by. */
static const uint32_t TANGENTS[{count}] = {{{tangents}
}};

",
        count = TANGENTS.len(),
        tangents = rows(TANGENTS.iter().map(|entry| format!("0x{entry:08x}")), 8),
    )
}

/// The code with rectifiers in place of tangents.
fn rectified_code() -> String {
    let [from, to] = TANGENT.map(|text| CODE.find(text).expect("the code has a tangent"));
    [&CODE[..from], RECTIFIER, &CODE[to..]].concat().replace("tangent(", "rectified(")
}

/// Each vector in braces of its own.
fn golden_rows(words: impl Iterator<Item = String>, per_vector: usize) -> String {
    let words: Vec<String> = words.collect();
    let vectors = words.chunks(per_vector).map(|vector| rows(vector.iter().cloned(), 8));
    vectors.map(|vector| format!("\n    {{{vector}\n    }},")).collect::<Vec<_>>().concat()
}
