//! Policies with images.

use super::*;
use crate::ranks::threads::run_as;
use kestrel_core::encoder::Volume;

/// Points and a picture of where they are.
pub(super) fn seeing() -> Task {
    Task { image: Some(Volume { rows: 10, columns: 12, channels: 4 }), ..task(true) }
}

fn with_encoder(sharing: EncoderSharing, trunk: &[usize]) -> PpoSettings {
    let encoder = EncoderSettings { kind: EncoderKind::Small, sharing, trunk: trunk.to_vec() };
    PpoSettings { environments: ENV_BATCH, steps_per_rollout: 3, minibatch: ENV_BATCH, encoder, ..settings() }
}

fn every_arrangement() -> [PpoSettings; 4] {
    let arrangement = with_encoder;
    [
        arrangement(EncoderSharing::Shared, &[]),
        arrangement(EncoderSharing::Separate, &[]),
        arrangement(EncoderSharing::Shared, &[24, 16]),
        arrangement(EncoderSharing::Separate, &[16]),
    ]
}

/// The loss of a slice, to which the entropy does not belong.
fn loss(slice: MinibatchSlice<'_>, (actor, critic): (&Actor, &Critic), settings: &PpoSettings) -> f64 {
    let sums = differentiated(slice, (actor, critic), settings).sums;
    (sums.policy_loss + f64::from(settings.value_weight) * sums.value_loss) / sums.samples
}

fn differentiated(slice: MinibatchSlice<'_>, (actor, critic): (&Actor, &Critic), settings: &PpoSettings) -> Shard {
    let mut encoders = EncoderWeights::default();
    encoders.arrange(actor, critic);
    let networks = Networks { actor, critic, encoders: &encoders };
    let mut shard = Shard::new(actor, critic);
    let columns = slice.returns.len();
    let loss = Loss { settings, sample_weight: 1.0 / columns as f32, imitation_weight: 0.0 };
    loss.differentiate(iter::once(slice), &networks, &mut SliceWorkspace::new(&networks, columns), &mut shard);
    shard
}

/// Along the gradient of a part of the parameters the loss rises as fast as that part is long, squared.
#[test]
fn every_part_of_the_gradient_is_the_slope_of_the_loss_along_it() {
    for settings in every_arrangement() {
        // A loss that is clipped has corners.
        let settings = PpoSettings { clip_range: 10.0, ..settings };
        let mut trainer = Trainer::new(&[seeing()], &settings, Seed(21));
        trainer.collect();
        trainer.normalise_advantages();
        // Heads of gain 0.01 would leave the encoder without a gradient worth measuring.
        let mut stream = Stream::new(Seed(22), 0, Purpose::Weights);
        trainer.actor.parameters_mut().iter_mut().for_each(|value| *value += 0.03 * stream.normal());
        let slice = trainer.env_batches[0].rollout().slice(5);
        assert_eq!((slice.returns.len(), slice.batch.images.len()), (64, 64 * 12 * 10 * 4));
        let (actor, critic) = (trainer.actor.clone(), trainer.critic.clone());
        let gradient = differentiated(slice, (&actor, &critic), &settings).gradient;
        let (log_std, network) = (actor.log_std_places(), critic.mlp().parameter_count());
        let parts = [
            (0..log_std.start, 0..0),
            (log_std.clone(), 0..0),
            (log_std.end..actor.parameters().len(), 0..0),
            (0..0, 0..network),
            (0..0, network..critic.parameters().len()),
        ];
        for (number, (of_actor, of_critic)) in parts.into_iter().enumerate() {
            let along = [&gradient.actor[of_actor.clone()], &gradient.critic[of_critic.clone()]].concat();
            let length = along.iter().map(|value| f64::from(value * value)).sum::<f64>().sqrt();
            if number == 4 && settings.encoder.sharing == EncoderSharing::Shared {
                assert!(along.is_empty(), "the critic has no encoder of its own");
                continue;
            }
            let at = |distance: f64| {
                let (mut actor, mut critic) = (actor.clone(), critic.clone());
                let moved = actor.parameters_mut()[of_actor.clone()].iter_mut();
                for (value, slope) in moved.chain(&mut critic.parameters_mut()[of_critic.clone()]).zip(&along) {
                    *value += (distance * f64::from(*slope) / length) as f32;
                }
                loss(slice, (&actor, &critic), &settings)
            };
            let slope = (at(3e-3) - at(-3e-3)) / 6e-3;
            let error = (slope / length - 1.0).abs();
            assert!(length > 1e-4 && error < 0.02, "{:?}, part {number}: {slope}, not {length}", settings.encoder);
        }
    }
}

#[test]
fn threads_and_interruptions_do_not_change_a_bit_of_what_a_vision_policy_learns() {
    for settings in every_arrangement() {
        let on = |threads: usize, resumed: bool| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a pool");
            pool.install(|| {
                let mut trainer = Trainer::new(&[seeing()], &settings, Seed(5));
                trainer.update();
                if resumed {
                    let bytes = postcard::to_allocvec(&trainer.save()).expect("a state serialises");
                    let state = postcard::from_bytes(&bytes).expect("and back");
                    trainer = Trainer::restore(&[seeing()], &settings, state).expect("it is the same run");
                }
                trainer.update();
                trainer.save()
            })
        };
        let reference = on(1, false);
        assert_eq!(reference, on(2, true));
        assert_eq!(reference, on(5, false));
    }
}

#[test]
fn a_small_minibatch_makes_many_steps() {
    let settings = PpoSettings { minibatch: 32, ..with_encoder(EncoderSharing::Shared, &[]) };
    let mut trainer = Trainer::new(&[seeing()], &settings, Seed(5));
    assert_eq!(trainer.columns(), 16);
    let metrics = trainer.update();
    assert!(metrics.policy_loss.is_finite() && metrics.gradient_norm > 0.0);
}

#[test]
fn ranks_show_each_other_their_images() {
    let settings = PpoSettings { environments: 2 * ENV_BATCH, ..with_encoder(EncoderSharing::Shared, &[]) };
    let course = |ranks: &Arc<dyn Ranks>| {
        let mut trainer = Trainer::new(&[seeing()], &settings, Seed(5));
        trainer.work_with(ranks).unwrap();
        trainer.update();
        trainer.update();
        trainer.save()
    };
    let alone = course(&ranks::alone());
    for found in run_as(2, |ranks| course(&ranks)) {
        assert!(found == alone);
    }
}

#[test]
fn a_policy_without_its_images_or_with_another_encoder_is_refused() {
    let settings = with_encoder(EncoderSharing::Shared, &[]);
    let state = Trainer::new(&[seeing()], &settings, Seed(5)).save();
    let without = Task { image: None, ..seeing() };
    let refuse = |task: Task, settings: &PpoSettings| {
        Trainer::restore(&[task], settings, state.clone()).expect_err("it is another run").to_string()
    };
    assert!(refuse(without, &settings).starts_with("the saved actor has layers [70, 16, 16, 2]"));
    let convolutions = vec![kestrel_core::encoder::Convolution { filters: 8, kernel: 3, stride: 2 }];
    let kind = EncoderKind::Custom { convolutions, features: 64 };
    let other =
        PpoSettings { encoder: EncoderSettings { kind, ..EncoderSettings::default() }, ..settings.clone() };
    let expected = "the saved actor looks at images in another way than scenario and settings ask for";
    assert_eq!(refuse(seeing(), &other), expected);
}
