//! Programs that do what COLMAP and ffmpeg would.

use image::{Rgb, RgbImage};
use io_colmap::{Camera, CameraModel, Model, Pose, View};
use scene_capture::{Colmap, Ffmpeg, Progress, Tools, Watch};
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, Ordering};

/// A folder with programs, what they were told, and what they are to write.
pub(crate) struct Workshop {
    pub(crate) dir: tempfile::TempDir,
}

/// Which version of COLMAP to play.
#[derive(Clone, Copy, PartialEq)]
pub(crate) enum Dialect {
    Three,
    Four,
}

impl Workshop {
    pub(crate) fn new() -> Self {
        let dir = tempfile::tempdir().unwrap();
        Self { dir }
    }

    pub(crate) fn path(&self, name: &str) -> PathBuf {
        self.dir.path().join(name)
    }

    /// A folder of photos.
    pub(crate) fn photos(&self, names: &[&str]) -> PathBuf {
        let folder = self.path("photos");
        for name in names {
            let path = folder.join(name);
            fs::create_dir_all(path.parent().unwrap()).unwrap();
            RgbImage::new(64, 48).save(path).unwrap();
        }
        folder
    }

    /// A model that an attempt of the mapper gives.
    pub(crate) fn model(&self, attempt: usize, number: usize, names: &[&str]) {
        self.write_model(&format!("models-{attempt}/{number}"), names);
    }

    /// What models are merged to; nothing otherwise.
    pub(crate) fn merged(&self, names: &[&str]) {
        self.write_model("merged", names);
    }

    fn write_model(&self, folder: &str, names: &[&str]) {
        let folder = self.path(folder);
        let mut model = Model::default();
        let camera = Camera {
            id: 1,
            model: CameraModel::SimpleRadial,
            width: 64,
            height: 48,
            params: vec![60.0, 32.0, 24.0, 0.0],
        };
        model.cameras.insert(1, camera);
        model.views = (1..)
            .zip(names)
            .map(|(id, name)| View {
                id,
                name: (*name).to_owned(),
                camera_id: 1,
                camera_from_world: Pose::IDENTITY,
            })
            .collect();
        model.write_binary(&folder).unwrap();
    }

    pub(crate) fn script(&self, name: &str, text: &str) -> PathBuf {
        let (path, written) = (self.path(name), self.path(&format!("{name}.sh")));
        fs::write(&written, format!("#!/bin/sh\n{text}\n")).unwrap();
        // Another process opens it for writing: from this one a program that another test starts just then inherits
        // the open file, and as long as it has it, the script is busy.
        let install = Command::new("install")
            .args(["-m", "755"])
            .args([&written, &path])
            .status();
        assert!(install.unwrap().success());
        path
    }

    /// A COLMAP whose commands do this before what they do usually.
    pub(crate) fn colmap(&self, dialect: Dialect, before: &str) -> Colmap {
        let (banner, options, features, block) = match dialect {
            Dialect::Three => (
                "COLMAP 3.8 -- Structure-from-Motion and Multi-View Stereo",
                "--SiftExtraction.use_gpu arg (=1)\n  --SiftMatching.use_gpu arg (=1)",
                "Processed file [$i/$n]",
                "Matching block [1/1, 1/1] in 0.1s",
            ),
            Dialect::Four => (
                "COLMAP 4.1.1 (Commit 1 on 2026-07-17 without GPU support)",
                "--FeatureExtraction.use_gpu arg (=1)\n  --FeatureMatching.use_gpu arg (=1)",
                "I20260808 20:28:58.123456 1 x.cc:271] Processed file [$i/$n]",
                "I20260808 20:28:58.123456 1 x.cc:211] Processing block [1/1, 1/1]",
            ),
        };
        let here = self.dir.path().display();
        let stream = if dialect == Dialect::Four { ">&2" } else { "" };
        let text = format!(
            r#"
if [ "$1" = help ]; then echo "{banner}"; exit 0; fi
if [ "$1 $2" = "model_merger -h" ]; then printf '  --input_path2 arg\n  --output_path arg\n'; exit 0; fi
if [ "$2" = -h ]; then printf '  --database_path arg\n  {options}\n'; exit 0; fi
echo "$@" >> '{here}/told'
{before}
command=$1; shift
while [ $# -gt 0 ]; do
    case $1 in
        --image_list_path) list=$2;;
        --input_path) in=$2;;
        --output_path) out=$2;;
    esac
    shift 2
done
case $command in
    feature_extractor)
        cat "$list" >> '{here}/listed'; echo >> '{here}/listed'
        n=$(grep -c . "$list"); i=0
        while [ $i -lt $n ]; do i=$((i + 1)); echo "{features}" {stream}; done;;
    exhaustive_matcher | sequential_matcher | spatial_matcher)
        echo "{block}" {stream};;
    model_merger)
        if [ -d '{here}/merged' ]; then cp -r '{here}/merged/.' "$out"; else exit 1; fi;;
    bundle_adjuster | point_triangulator)
        cp -r "$in/." "$out";;
    mapper)
        touch '{here}/attempts'
        attempt=$(grep -c . '{here}/attempts'); echo one >> '{here}/attempts'
        if [ -d "{here}/models-$attempt" ]; then
            cp -r "{here}/models-$attempt/." "$out"
            echo "Registering image #1 (3)" {stream}
        else
            echo "ERROR: failed to create sparse model" >&2; exit 1
        fi;;
esac"#,
            options = options.replace('\n', "\\n"),
        );
        Colmap::at(&self.script("colmap", &text)).unwrap()
    }

    pub(crate) fn tools(&self, dialect: Dialect) -> Tools {
        Tools {
            colmap: self.colmap(dialect, ""),
            ffmpeg: None,
        }
    }

    /// An ffmpeg that sends these pictures, and ends so.
    pub(crate) fn ffmpeg(&self, pictures: &[RgbImage], seconds: f64, end: &str) -> Ffmpeg {
        let mut stream = Vec::new();
        for picture in pictures {
            let (width, height) = picture.dimensions();
            stream.extend(format!("P6\n{width} {height}\n255\n").bytes());
            stream.extend_from_slice(picture);
        }
        fs::write(self.path("stream"), stream).unwrap();
        let here = self.dir.path().display();
        let ffmpeg = self.script(
            "ffmpeg",
            &format!("echo \"$@\" >> '{here}/told'\ncat '{here}/stream'\n{end}"),
        );
        let answer = format!(
            r#"{{"streams": [{{"width": 64, "height": 48, "avg_frame_rate": "10/1",
                "duration": "{seconds}"}}], "format": {{}}}}"#
        );
        let ffprobe = self.script("ffprobe", &format!("cat <<'END'\n{answer}\nEND"));
        Ffmpeg::at(&ffmpeg, &ffprobe)
    }

    /// What the programs were told, a line per call, without the folder of the test.
    pub(crate) fn told(&self) -> Vec<String> {
        let text = fs::read_to_string(self.path("told")).unwrap_or_default();
        text.lines().map(str::to_owned).collect()
    }

    /// What lies in the folder of the test, apart from what the stand-ins need.
    pub(crate) fn has_leftovers(&self) -> bool {
        fs::read_dir(self.dir.path()).unwrap().any(|entry| {
            let name = entry.unwrap().file_name();
            name.to_string_lossy().starts_with(".sos-partial")
        })
    }
}

/// Stripes of that contrast, from a place that changes with `at`.
pub(crate) fn stripes(at: u32, contrast: u8) -> RgbImage {
    RgbImage::from_fn(64, 48, |x, _| {
        Rgb([100 + contrast * u8::from(((x + at) / 8).is_multiple_of(2)); 3])
    })
}

/// Writes down what it hears.
#[derive(Default)]
pub(crate) struct Listener {
    pub(crate) progress: Mutex<Vec<Progress>>,
    pub(crate) notes: Mutex<Vec<String>>,
    pub(crate) stop: AtomicBool,
}

impl Watch for Listener {
    fn progress(&self, progress: Progress) {
        self.progress.lock().unwrap().push(progress);
    }

    fn note(&self, sentence: &str) {
        self.notes.lock().unwrap().push(sentence.to_owned());
    }

    fn interrupted(&self) -> bool {
        self.stop.load(Ordering::SeqCst)
    }
}

/// A file's text.
pub(crate) fn text(path: &Path) -> String {
    fs::read_to_string(path).unwrap()
}
