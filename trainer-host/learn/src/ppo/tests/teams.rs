//! Several drones of an environment learn together.

use super::*;

/// Teams of drones with goals of their own, whose episodes end alone.
fn team(count: u32) -> Scenario {
    let goal = |drone: u32| Vector3::new(2.0 * f64::from(drone), 0.0, 1.0);
    Scenario {
        agents: Agents { count, ends: TeamEnd::Alone, rewards: TeamRewards::Shared, success: TeamSuccess::Own },
        goals: Goals::PerAgent((0..count).map(goal).collect()),
        ..scenario(CriticView::Privileged)
    }
}

/// The critic of MAPPO.
fn mappo() -> PpoSettings {
    PpoSettings { critic_scope: CriticScope::Team, value_scale: ValueScaling::PopArt, ..settings() }
}

fn collection(trainer: &Trainer) -> Collection<'_> {
    Collection {
        networks: Networks { actor: trainer.actor(), critic: trainer.critic(), eyes: &trainer.eyes },
        first_step: 0,
        reward_scale: 1.0,
        discount: 0.98,
        gae_lambda: 0.95,
        is_taught: false,
    }
}

#[test]
fn all_drones_of_all_environments_fly() {
    // 768 drones are three panels of pairs, or one panel of threes.
    for (count, panels, environments) in [(2, 3, 384), (3, 1, 256)] {
        let trainer = Trainer::new(&[team(count)], &settings(), Seed(5));
        let mut flown: Vec<(u32, u32)> = Vec::new();
        assert_eq!(trainer.panels.len(), panels);
        for panel in &mut trainer.panels.clone() {
            panel.collect(&collection(&trainer));
            panel.collect(&Collection { first_step: 12, ..collection(&trainer) });
            flown.extend(panel.take_episodes().iter().map(|episode| (episode.environment, episode.agent)));
        }
        flown.sort_unstable();
        flown.dedup();
        let all = (0..environments).flat_map(|environment| (0..count).map(move |agent| (environment, agent)));
        assert!(flown.into_iter().eq(all), "teams of {count}");
    }
}

#[test]
fn runs_of_several_drones_resume_to_the_same_bits_on_any_number_of_threads() {
    let on_threads = |count: u32, settings: &PpoSettings, threads: usize, parts: [u32; 2]| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a pool");
        pool.install(|| {
            let mut trainer = Trainer::new(&[team(count)], settings, Seed(5));
            (0..parts[0]).for_each(|_| drop(trainer.update()));
            let bytes = postcard::to_allocvec(&trainer.save()).expect("a state serialises");
            let state = postcard::from_bytes(&bytes).expect("and back");
            let mut trainer = Trainer::restore(&[team(count)], settings, state).expect("it is the same run");
            (0..parts[1]).for_each(|_| drop(trainer.update()));
            trainer.save()
        })
    };
    for (count, settings) in [(2, settings()), (2, mappo()), (3, mappo())] {
        let reference = on_threads(count, &settings, 1, [3, 0]);
        assert_eq!(reference, on_threads(count, &settings, 2, [1, 2]), "teams of {count}");
        assert_eq!(reference, on_threads(count, &settings, 7, [2, 1]), "teams of {count}");
    }
}

#[test]
fn a_team_critic_reads_the_drone_itself_then_its_mates_in_a_circle() {
    let mut trainer = Trainer::new(&[team(3)], &mappo(), Seed(5));
    let own = 22 + PRIVILEGED_LEN;
    assert_eq!((trainer.actor().mlp().inputs(), trainer.critic().mlp().inputs()), (22, 3 * own));
    trainer.collect();
    let rollout = trainer.panels[0].rollout();
    // In a panel of 256 threes, the tiles of a step are the first drones, the second ones, the third ones.
    for step in 0..12 {
        let block = |agent: usize, mate: usize| {
            let tile = rollout.tile(3 * step + agent);
            &tile.sight.values[mate * own * PANEL..(mate + 1) * own * PANEL]
        };
        for (agent, mate) in [(0, 1), (0, 2), (1, 1), (1, 2), (2, 1), (2, 2)] {
            assert_eq!(
                block(agent, mate),
                block((agent + mate) % 3, 0),
                "step {step}, drone {agent}, mate {mate}"
            );
        }
    }
}

#[test]
fn pairs_stand_beside_each_other_within_a_tile() {
    let mut trainer = Trainer::new(&[team(2)], &mappo(), Seed(5));
    let own = (22 + PRIVILEGED_LEN) * PANEL;
    trainer.collect();
    let tile = trainer.panels[2].rollout().tile(7);
    let (own, mates) = tile.sight.values.split_at(own);
    for (own, mates) in own.chunks_exact(PANEL).zip(mates.chunks_exact(PANEL)) {
        let (first, second) = own.split_at(PANEL / 2);
        assert_eq!(mates, [second, first].concat());
    }
}

#[test]
fn a_critic_of_one_drone_reads_itself_whatever_its_scope() {
    let state = |settings: &PpoSettings| {
        let mut trainer = Trainer::new(&[scenario(CriticView::Privileged)], settings, Seed(4));
        trainer.update();
        trainer.save()
    };
    assert_eq!(state(&settings()), state(&PpoSettings { critic_scope: CriticScope::Team, ..settings() }));
}

#[test]
fn the_critic_of_another_scope_is_refused() {
    let state = Trainer::new(&[team(3)], &settings(), Seed(7)).save();
    let own = 22 + PRIVILEGED_LEN;
    assert_eq!(
        Trainer::restore(&[team(3)], &mappo(), state).expect_err("it must be refused").to_string(),
        format!("the saved critic has layers [{own}, 16, 1], the settings ask for [{}, 16, 1]", 3 * own)
    );
}

#[test]
fn the_scope_of_the_critic_changes_no_flight_before_the_first_update() {
    let flown = |settings: &PpoSettings| {
        let mut trainer = Trainer::new(&[team(3)], settings, Seed(8));
        trainer.collect();
        let rollout = trainer.panels[0].rollout();
        (0..rollout.tiles()).flat_map(|tile| rollout.tile(tile).actions.to_vec()).collect::<Vec<f32>>()
    };
    assert_eq!(flown(&settings()), flown(&mappo()));
}
