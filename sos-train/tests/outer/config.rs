//! Layers of configuration, and what they say about mistakes.

use io_colmap::{Camera, CameraModel, Model, Pose, View};
use sos_train::config::{
    AlphaSource, ConfigError, InputRecord, MaskPolarity, Preset, RunRecord, TrainConfig,
};

const PRESETS: [Preset; 3] = [Preset::Quick, Preset::Default, Preset::Paper];

fn input() -> InputRecord {
    InputRecord {
        scene: "/photos/a \"quoted\" cat".into(),
        masks: Some("/photos/masks".into()),
        polarity: Some(MaskPolarity::Black),
        ignore: None,
        out: "/runs/cat".into(),
        demo: false,
        imported_from: None,
        photos: None,
        click: None,
        object_box: None,
    }
}

#[test]
fn every_preset_is_valid_and_survives_its_file() {
    for preset in PRESETS {
        let config = TrainConfig::preset(preset);
        assert_eq!(config.preset, preset);
        config.validate().unwrap();
        let record = RunRecord::new(config, input());
        let text = record.to_toml().unwrap();
        assert_eq!(RunRecord::from_toml(&text).unwrap(), record, "{text}");
    }
    assert_eq!(TrainConfig::default(), TrainConfig::preset(Preset::Default));
}

/// A hint is a table within what the run was given, and no setting.
#[test]
fn hints_survive_the_file() {
    let click = sos_train::discover::hint::Click {
        view: "000.jpg".to_owned(),
        x: 274.0,
        y: 278.5,
    };
    let object_box = sos_train::discover::hint::WorldBox {
        low: [-1.0, 0.0, 0.5],
        high: [1.0, 2.0, 3.0],
    };
    for (click, object_box) in [(Some(click), None), (None, Some(object_box))] {
        let input = InputRecord {
            click,
            object_box,
            ..input()
        };
        let record = RunRecord::new(TrainConfig::default(), input);
        let text = record.to_toml().unwrap();
        assert_eq!(RunRecord::from_toml(&text).unwrap(), record, "{text}");
    }
}

#[test]
fn the_file_shows_values_as_a_person_would_write_them() {
    let text = RunRecord::new(TrainConfig::default(), input())
        .to_toml()
        .unwrap();
    for line in [
        "eikonal = 0.03",
        "preset = \"default\"",
        "[model]",
        "[input]",
        "[versions]",
    ] {
        assert!(
            text.lines().any(|l| l == line),
            "{line} is missing in\n{text}"
        );
    }
}

#[test]
fn the_paper_preset_has_the_numbers_of_the_paper() {
    let paper = TrainConfig::preset(Preset::Paper);
    assert_eq!(paper.steps, 40_000);
    assert_eq!(paper.schedule.learning_rate, 0.01);
    let model = &paper.model;
    assert_eq!(
        (model.levels, model.base_resolution, model.finest_resolution),
        (16, 16, 2048)
    );
    assert_eq!(
        (
            model.hidden,
            model.object_features,
            model.background_features
        ),
        (64, 12, 7)
    );
    assert_eq!(
        (model.alpha, model.log2_table_size),
        (AlphaSource::Head, 19)
    );
}

#[test]
fn every_key_can_be_set_to_what_it_is() {
    let keys = TrainConfig::keys();
    assert!(keys.len() > 50, "{keys:?}");
    let text = RunRecord::new(TrainConfig::default(), input())
        .to_toml()
        .unwrap();
    let tree: toml::Table = text.parse().unwrap();
    for key in keys.iter().filter(|key| *key != "preset") {
        let value = match key.split_once('.') {
            Some((section, name)) => &tree[section][name],
            None => &tree[key.as_str()],
        };
        let mut config = TrainConfig::default();
        config.apply_override(&format!("{key}={value}")).unwrap();
        assert_eq!(config, TrainConfig::default(), "{key}");
    }
}

#[test]
fn overrides_take_words_integers_for_floats_and_powers_for_counts() {
    let mut config = TrainConfig::default();
    for assignment in [
        "model.alpha=both",
        " loss.mask = 1 ",
        "steps=1e4",
        "device=flex",
        "loss.colour=\"l1\"",
        "seed=7",
    ] {
        config.apply_override(assignment).unwrap();
    }
    assert_eq!(config.model.alpha, AlphaSource::Both);
    assert_eq!(config.loss.mask, 1.0);
    assert_eq!((config.steps, config.seed), (10_000, 7));
    assert_eq!(config.device, "flex");
}

#[test]
fn a_misspelt_key_is_answered_with_the_nearest() {
    for (given, meant) in [
        ("loss.mosk=1", "loss.mask?"),
        ("mask=1", "loss.mask?"),
        ("model.mask_end=0.5", "loss.mask_end?"),
        ("sampling.ray=9", "sampling.rays?"),
        ("step=9", "steps?"),
        ("learning_rate=0.1", "schedule.learning_rate?"),
    ] {
        let before = TrainConfig::default();
        let mut config = before.clone();
        let error = config.apply_override(given).unwrap_err();
        assert!(matches!(error, ConfigError::UnknownKey { .. }), "{error:?}");
        assert!(
            error.to_string().contains(&format!("did you mean {meant}")),
            "{given}: {error}"
        );
        assert_eq!(config, before);
    }
    let error = TrainConfig::default()
        .apply_override("completely.different=1")
        .unwrap_err();
    assert!(error.to_string().contains("config.toml"), "{error}");
    assert!(TrainConfig::default().apply_override("loss=1").is_err());
    assert!(
        TrainConfig::default()
            .apply_override("model.alpha.x=1")
            .is_err()
    );
}

#[test]
fn a_value_of_the_wrong_kind_is_named() {
    for (given, says) in [
        ("loss.mask=much", "a number is needed"),
        ("loss.mask=nan", "a finite number is needed"),
        ("steps=1.5", "a whole number is needed"),
        ("steps=-3", "cannot be negative"),
        ("steps=99999999999", "steps = 99999999999"),
        ("model.alpha=heads", "did you mean head?"),
        ("loss.mask=", "a number is needed"),
        ("device=3", "a word is needed"),
        ("preset=paper", "--preset"),
        ("loss.mask", "key=value"),
    ] {
        let error = TrainConfig::default()
            .apply_override(given)
            .unwrap_err()
            .to_string();
        assert!(error.contains(says), "{given}: {error}");
        assert!(!error.contains('\n'), "{error}");
    }
}

#[test]
fn values_out_of_range_are_found() {
    for (given, key) in [
        ("steps=10000001", "steps"),
        ("device=gpu", "device"),
        ("loss.mask_hold=0.9", "loss.mask_end"),
        ("loss.ignore_band=2", "loss.ignore_band"),
        ("model.finest_resolution=8", "model.finest_resolution"),
        ("schedule.learning_rate=0", "schedule.learning_rate"),
        ("sampling.rays=0", "sampling.rays"),
        ("loss.eikonal=-1", "loss.eikonal"),
    ] {
        let mut config = TrainConfig::default();
        config.apply_override(given).unwrap();
        let error = config.validate().unwrap_err().to_string();
        assert!(error.starts_with(key), "{given}: {error}");
    }
    // Finite where it is read, and not where it is kept.
    let mut config = TrainConfig::default();
    config.apply_override("loss.mask=1e39").unwrap();
    let error = config.validate().unwrap_err().to_string();
    assert!(error.contains("a finite number of at least 0"), "{error}");
    // A semantic field is a density.
    let mut config = TrainConfig::default();
    config.apply_override("model.fields=semantic").unwrap();
    config.validate().unwrap();
    config.apply_override("model.background=sdf").unwrap();
    let error = config.validate().unwrap_err().to_string();
    assert!(error.contains("model.background"), "{error}");
    let config = TrainConfig {
        seed: u64::MAX,
        ..TrainConfig::default()
    };
    assert!(config.validate().is_err());
}

#[test]
fn two_settings_that_only_fit_together_can_be_given_in_any_order() {
    let mut config = TrainConfig::default();
    config.apply_override("loss.mask_hold=0.5").unwrap();
    config.apply_override("loss.mask_end=0.6").unwrap();
    config.validate().unwrap();
}

#[test]
fn a_file_by_hand_fills_up_from_its_preset() {
    let record = RunRecord::from_toml("preset = \"paper\"\n[loss]\nmask = 0.5\n").unwrap();
    let mut expected = TrainConfig::preset(Preset::Paper);
    expected.loss.mask = 0.5;
    assert_eq!(record.config, expected);
    assert_eq!(record.input, None);
    let laid = TrainConfig::default()
        .with_toml("[loss]\nmask = 0.5\n")
        .unwrap();
    assert_eq!(laid.loss.mask, 0.5);
}

#[test]
fn mistakes_in_a_file_are_one_sentence() {
    for (text, says) in [
        ("steps = \n", "line 1"),
        ("[loss]\nmosk = 1\n", "loss.mask?"),
        ("[modell]\nlevels = 3\n", "model.levels?"),
        ("preset = \"huge\"\n", "quick, default, paper"),
        ("steps = \"many\"\n", "a whole number"),
        ("[input]\nscenes = \"x\"\n", "input"),
        ("loss = 3\n", "loss"),
    ] {
        let error = RunRecord::from_toml(text).unwrap_err().to_string();
        assert!(error.contains(says), "{text:?}: {error}");
        assert!(!error.contains('\n'), "{error}");
    }
}

#[test]
fn errors_in_a_file_name_the_line_and_what_was_meant() {
    for (text, says) in [
        (
            "seed = 2\nstesp = 7\n",
            "line 2: there is no setting \"stesp\"; did you mean steps?",
        ),
        (
            "# loss.mask\n[model]\n\n[loss]\nmask = 0.1\nmosk = 1\n",
            "line 6: there is no setting \"loss.mosk\"; did you mean loss.mask?",
        ),
        (
            "loss.colour = \"l3\"\n",
            "line 1: loss.colour = \"l3\" cannot be used: it can be l2, huber, l1; did you mean l2?",
        ),
        (
            "[model]\nhidden = 64\nfields = \"objct\"",
            "line 3: model.fields = \"objct\" cannot be used: it can be both, object, semantic; did you mean object?",
        ),
        (
            "steps = 3\npreset = \"quik\"",
            "line 2: preset = \"quik\" cannot be used: it can be quick, default, paper; did you mean quick?",
        ),
        ("\n[export]\nedge_rays = -3\n", "line 3: export.edge_rays"),
        ("steps = 10000001\n", "line 1: steps"),
    ] {
        let error = RunRecord::from_toml(text).unwrap_err().to_string();
        assert!(error.starts_with(says), "{error}");
    }
}

#[test]
fn what_a_checkpoint_has_built_in_cannot_change() {
    let saved = TrainConfig::default();
    for given in ["model.levels=8", "seed=3", "prepare.box_margin=0.3"] {
        let mut config = saved.clone();
        config.apply_override(given).unwrap();
        let error = config.check_resumes(&saved).unwrap_err();
        assert!(
            matches!(error, ConfigError::FixedOnResume { .. }),
            "{error:?}"
        );
    }
    let mut config = saved.clone();
    for given in [
        "steps=9000",
        "loss.mask=0",
        "device=flex",
        "export.edge_rays=16",
        "model.table_reads=half",
    ] {
        config.apply_override(given).unwrap();
    }
    config.check_resumes(&saved).unwrap();
}

#[test]
fn the_readme_explains_every_key() {
    let readme = include_str!("../../README.md");
    for key in TrainConfig::keys().iter().filter(|key| *key != "preset") {
        assert!(readme.contains(&format!("`{key}`")), "{key}");
    }
}

/// A model whose views share one camera; only sizes matter here.
fn model(views: u32, (width, height): (u32, u32)) -> Model {
    let camera = Camera {
        id: 1,
        model: CameraModel::SimplePinhole,
        width,
        height,
        params: vec![500.0, f64::from(width) / 2.0, f64::from(height) / 2.0],
    };
    let view = |id| View {
        id,
        name: format!("{id}.png"),
        camera_id: 1,
        camera_from_world: Pose::IDENTITY,
    };
    Model {
        cameras: [(1, camera)].into(),
        views: (0..views).map(view).collect(),
        points: Vec::new(),
    }
}

#[test]
fn steps_left_open_follow_the_pixels_and_stated_ones_stay() {
    let mut config = TrainConfig::default();
    let steps = |config: &TrainConfig, views, size| config.settled(&model(views, size)).steps;
    let small = steps(&config, 28, (320, 240));
    let middle = steps(&config, 28, (400, 300));
    assert!(small < middle, "{small} {middle}");
    let large = steps(&config, 48, (640, 480));
    assert_eq!(large, steps(&config, 400, (4000, 3000)));
    config.prepare.downscale = 2;
    assert_eq!(small, steps(&config, 28, (640, 480)));
    config.steps = 17;
    assert_eq!(17, steps(&config, 48, (640, 480)));
}
