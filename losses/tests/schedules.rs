//! Schedules at their corners, beyond them, and from configuration text.

use losses::{Knot, Knots, Schedule, ScheduleError};

fn knot(step: u64, value: f64) -> Knot {
    Knot { step, value }
}

fn piecewise(knots: &[Knot]) -> Schedule {
    Schedule::PiecewiseLinear {
        knots: Knots::new(knots.to_vec()).expect("increasing"),
    }
}

fn assert_values(schedule: &Schedule, expected: &[(u64, f64)]) {
    for &(step, value) in expected {
        let actual = schedule.at(step);
        assert!(
            (actual - value).abs() < 1e-12,
            "{schedule:?} at {step}: {actual}, not {value}"
        );
    }
}

#[test]
fn constant_is_constant() {
    assert_values(
        &Schedule::Constant { value: 0.3 },
        &[(0, 0.3), (u64::MAX, 0.3)],
    );
}

#[test]
fn a_ramp_holds_then_falls_to_zero() {
    let ramp = Schedule::RampToZero {
        value: 0.1,
        from: 2000,
        to: 6000,
    };
    let expected = [
        (0, 0.1),
        (2000, 0.1),
        (3000, 0.075),
        (5999, 0.1 / 4000.0),
        (6000, 0.0),
        (u64::MAX, 0.0),
    ];
    assert_values(&ramp, &expected);
}

#[test]
fn a_ramp_of_no_length_is_a_step() {
    let step = Schedule::RampToZero {
        value: 0.1,
        from: 10,
        to: 10,
    };
    assert_values(&step, &[(9, 0.1), (10, 0.1), (11, 0.0)]);
    let reversed = Schedule::RampToZero {
        value: 0.1,
        from: 10,
        to: 3,
    };
    assert_values(&reversed, &[(5, 0.1), (10, 0.1), (11, 0.0)]);
}

#[test]
fn warm_up_rises_from_the_first_step_and_decays_to_the_ratio() {
    let rate = Schedule::WarmUpDecay {
        peak: 0.01,
        warm_up: 500,
        end: 20_500,
        final_ratio: 0.01,
    };
    let expected = [
        (0, 0.01 / 500.0),
        (499, 0.01),
        (500, 0.01),
        (10_500, 0.001),
        (20_500, 0.0001),
        (30_000, 0.0001),
    ];
    assert_values(&rate, &expected);
}

#[test]
fn warm_up_and_decay_may_be_missing() {
    let decay = Schedule::WarmUpDecay {
        peak: 1.0,
        warm_up: 0,
        end: 2,
        final_ratio: 0.25,
    };
    assert_values(&decay, &[(0, 1.0), (1, 0.5), (2, 0.25)]);
    let all_warm_up = Schedule::WarmUpDecay {
        peak: 1.0,
        warm_up: 4,
        end: 2,
        final_ratio: 0.25,
    };
    assert_values(&all_warm_up, &[(0, 0.25), (3, 1.0), (4, 0.25)]);
}

#[test]
fn piecewise_linear_meets_its_knots() {
    let schedule = piecewise(&[knot(10, 1.0), knot(20, 3.0), knot(40, -1.0)]);
    let expected = [
        (0, 1.0),
        (10, 1.0),
        (15, 2.0),
        (20, 3.0),
        (30, 1.0),
        (40, -1.0),
        (99, -1.0),
    ];
    assert_values(&schedule, &expected);
    assert_values(&piecewise(&[knot(7, 0.5)]), &[(0, 0.5), (7, 0.5), (8, 0.5)]);
}

#[test]
fn knots_must_increase() {
    assert_eq!(Knots::new(vec![]), Err(ScheduleError::NoKnots));
    let unordered = Knots::new(vec![knot(5, 1.0), knot(5, 2.0)]);
    assert_eq!(
        unordered,
        Err(ScheduleError::Unordered {
            previous: 5,
            next: 5
        })
    );
}

#[test]
fn stretching_scales_every_step() {
    let ramp = Schedule::RampToZero {
        value: 0.1,
        from: 2000,
        to: 6000,
    };
    let expected = Schedule::RampToZero {
        value: 0.1,
        from: 500,
        to: 1500,
    };
    assert_eq!(ramp.stretched(0.25), expected);

    let rate = Schedule::WarmUpDecay {
        peak: 1.0,
        warm_up: 500,
        end: 20_000,
        final_ratio: 0.1,
    };
    let expected = Schedule::WarmUpDecay {
        peak: 1.0,
        warm_up: 1000,
        end: 40_000,
        final_ratio: 0.1,
    };
    assert_eq!(rate.stretched(2.0), expected);

    // Knots that meet are merged, so that steps still increase.
    let knots = piecewise(&[knot(0, 0.0), knot(1, 0.5), knot(1000, 1.0)]);
    assert_eq!(
        knots.stretched(0.01),
        piecewise(&[knot(0, 0.5), knot(10, 1.0)])
    );
}

#[test]
fn every_kind_survives_serialisation() {
    let schedules = [
        Schedule::Constant { value: 0.1 },
        Schedule::RampToZero {
            value: 0.1,
            from: 2,
            to: 6,
        },
        Schedule::WarmUpDecay {
            peak: 0.01,
            warm_up: 5,
            end: 20,
            final_ratio: 0.1,
        },
        piecewise(&[knot(0, 0.0), knot(9, 0.5)]),
    ];
    for schedule in schedules {
        let text = serde_json::to_string(&schedule).expect("serialises");
        assert_eq!(
            serde_json::from_str::<Schedule>(&text).expect("reads back"),
            schedule
        );
    }
}

#[test]
fn bad_text_is_refused_with_a_reason() {
    let unordered = r#"{"kind": "piecewise-linear",
        "knots": [{"step": 3, "value": 1}, {"step": 1, "value": 0}]}"#;
    let error = serde_json::from_str::<Schedule>(unordered).expect_err("unordered");
    assert!(
        error.to_string().contains("step 1 follows step 3"),
        "{error}"
    );
    let unknown = r#"{"kind": "constant", "value": 1, "until": 3}"#;
    assert!(serde_json::from_str::<Schedule>(unknown).is_err());
}
