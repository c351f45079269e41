//! Videos, by the installed ffmpeg, from frames that are handed over one by one.

use crate::error::ExportError;
use std::io::{Read as _, Write as _};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdin, Command, Stdio};
use std::thread::{JoinHandle, spawn};

const REMEDY: &str = "install ffmpeg (apt install ffmpeg, brew install ffmpeg, winget install ffmpeg) \
                      and do it again";
/// When it is there and fails: its reason, which stands before this, is in its own words.
const FAILED: &str =
    "that is ffmpeg's own reason; if the disk is full make room, else do without the videos";
/// When it is there and cannot even say what it can do.
const BROKEN: &str = "that is its own reason; install ffmpeg anew, or do without the videos";
/// A failure's reason is cut there.
const LONGEST_REASON: usize = 300;

/// The installed ffmpeg, and what it can write.
#[derive(Debug, Clone)]
pub struct Ffmpeg {
    program: PathBuf,
    encoders: Vec<String>,
}

/// What a video holds.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Codec {
    /// `.mp4` of colours, from `[height * width * 3]` bytes of sRGB.
    Mp4Colour,
    /// `.mp4` of one channel, from `[height * width]` bytes.
    Mp4Grey,
    /// `.mov` with alpha for editors: ProRes 4444, from `[height * width * 4]` 16-bit little-endian
    /// words, sRGB with straight alpha.
    ProRes4444,
    /// `.webm` with alpha for browsers: VP9, from `[height * width * 4]` bytes of sRGB with straight
    /// alpha.
    WebmAlpha,
}

impl Codec {
    /// The encoders that will do, best first, with their options.
    fn encoders(self) -> &'static [(&'static str, &'static [&'static str])] {
        match self {
            Codec::Mp4Colour | Codec::Mp4Grey => &[
                ("libx264", &["-crf", "16", "-preset", "medium"]),
                ("libopenh264", &["-b:v", "12M"]),
                ("h264_videotoolbox", &["-b:v", "12M"]),
                ("mpeg4", &["-q:v", "2"]),
            ],
            Codec::ProRes4444 => &[("prores_ks", &["-profile:v", "4444", "-alpha_bits", "16"])],
            Codec::WebmAlpha => &[(
                "libvpx-vp9",
                &[
                    "-crf",
                    "24",
                    "-b:v",
                    "0",
                    "-deadline",
                    "good",
                    "-cpu-used",
                    "5",
                    "-auto-alt-ref",
                    "0",
                ],
            )],
        }
    }

    /// The frames' layout, that of the video, and bytes per pixel of a frame.
    fn layout(self) -> (&'static str, &'static str, usize) {
        match self {
            Codec::Mp4Colour => ("rgb24", "yuv420p", 3),
            Codec::Mp4Grey => ("gray", "yuv420p", 1),
            Codec::ProRes4444 => ("rgba64le", "yuva444p10le", 8),
            Codec::WebmAlpha => ("rgba", "yuva420p", 4),
        }
    }
}

impl Ffmpeg {
    /// ffmpeg on the search path.
    ///
    /// # Errors
    /// [`ExportError::Program`], which says how to get it.
    pub fn find() -> Result<Self, ExportError> {
        Self::at(Path::new("ffmpeg"))
    }

    /// ffmpeg under this name or path.
    ///
    /// # Errors
    /// As [`Ffmpeg::find`].
    pub fn at(program: &Path) -> Result<Self, ExportError> {
        let output = Command::new(program)
            .args(["-hide_banner", "-encoders"])
            .stdin(Stdio::null())
            .output()
            .map_err(|e| ExportError::Program {
                program: program.to_path_buf(),
                what: match e.kind() {
                    std::io::ErrorKind::NotFound => "it was not found".to_owned(),
                    _ => format!("it does not start ({e})"),
                },
                remedy: REMEDY,
            })?;
        if !output.status.success() {
            return Err(ExportError::Program {
                program: program.to_path_buf(),
                what: last_words(&String::from_utf8_lossy(&output.stderr)),
                remedy: BROKEN,
            });
        }
        // " V..... libx264    H.264 / AVC …", below a legend.
        let encoders = String::from_utf8_lossy(&output.stdout)
            .lines()
            .filter_map(|line| {
                let mut words = line.split_whitespace();
                let kind = words.next()?;
                let name = words.next()?;
                (kind.starts_with('V') && kind.len() == 6).then(|| name.to_owned())
            })
            .collect();
        Ok(Self {
            program: program.to_path_buf(),
            encoders,
        })
    }

    /// Whether this build of ffmpeg can write such a video.
    #[must_use]
    pub fn can(&self, codec: Codec) -> bool {
        self.encoder(codec).is_some()
    }

    fn encoder(&self, codec: Codec) -> Option<(&'static str, &'static [&'static str])> {
        let has = |name: &str| self.encoders.iter().any(|known| known == name);
        codec.encoders().iter().copied().find(|(name, _)| has(name))
    }

    /// Begins a video of frames of `size`, in pixels, both even, at `rate` frames a second.
    ///
    /// # Errors
    /// [`ExportError::Program`] if it does not start, or cannot write such a video.
    ///
    /// # Panics
    /// If the width or height is odd, which half of the codecs cannot have.
    pub fn begin(
        &self,
        path: &Path,
        size: (u32, u32),
        rate: u32,
        codec: Codec,
    ) -> Result<Video, ExportError> {
        assert!(
            size.0.is_multiple_of(2) && size.1.is_multiple_of(2),
            "Ffmpeg::begin: argument size is {}x{}, which is odd",
            size.0,
            size.1
        );
        let Some((encoder, options)) = self.encoder(codec) else {
            let what = format!(
                "this build has no encoder for {}",
                path.file_name().unwrap_or_default().to_string_lossy()
            );
            return Err(self.failed(what, REMEDY));
        };
        let (frames, pixels, bytes) = codec.layout();
        let mut child = Command::new(&self.program)
            .args(["-hide_banner", "-loglevel", "error", "-nostats", "-y"])
            .args(["-f", "rawvideo", "-pix_fmt", frames])
            .args(["-s", &format!("{}x{}", size.0, size.1)])
            .args(["-r", &rate.to_string(), "-i", "-", "-an"])
            // Players take what is not said to be BT.709 for whatever they like.
            .args([
                "-vf",
                &format!("scale=out_color_matrix=bt709,format={pixels}"),
            ])
            .args(["-colorspace", "bt709", "-color_primaries", "bt709"])
            .args(["-color_trc", "iec61966-2-1", "-c:v", encoder])
            .args(options)
            .arg(path)
            .stdin(Stdio::piped())
            .stdout(Stdio::null())
            .stderr(Stdio::piped())
            .spawn()
            .map_err(|e| self.failed(format!("it does not start ({e})"), REMEDY))?;
        let errors = child.stderr.take();
        Ok(Video {
            ffmpeg: self.clone(),
            frame_bytes: size.0 as usize * size.1 as usize * bytes,
            input: child.stdin.take(),
            // Read as it comes: a program whose complaints nobody reads would wait for ever.
            complaints: Some(spawn(move || {
                let mut text = Vec::new();
                if let Some(mut errors) = errors {
                    let _ = errors.read_to_end(&mut text);
                }
                String::from_utf8_lossy(&text).into_owned()
            })),
            child,
        })
    }

    /// That it can write none of the videos that are wanted.
    pub(crate) fn can_nothing(&self) -> ExportError {
        let what = "this build has no encoder for any of the videos";
        self.failed(what.to_owned(), REMEDY)
    }

    fn failed(&self, what: String, remedy: &'static str) -> ExportError {
        ExportError::Program {
            program: self.program.clone(),
            what,
            remedy,
        }
    }
}

/// A video in the making. One that is dropped before its end is left incomplete, and ffmpeg ended.
#[derive(Debug)]
pub struct Video {
    ffmpeg: Ffmpeg,
    frame_bytes: usize,
    input: Option<ChildStdin>,
    complaints: Option<JoinHandle<String>>,
    child: Child,
}

impl Video {
    /// Adds a frame; see [`Codec`] for what it holds.
    ///
    /// # Errors
    /// [`ExportError::Program`] if ffmpeg has given up, with what it said.
    ///
    /// # Panics
    /// If the frame is not as long as size and codec have it.
    pub fn push(&mut self, frame: &[u8]) -> Result<(), ExportError> {
        assert_eq!(
            frame.len(),
            self.frame_bytes,
            "Video::push: argument frame has another length than the video's frames"
        );
        let written = match &mut self.input {
            Some(input) => input.write_all(frame),
            None => Ok(()),
        };
        match written {
            Ok(()) => Ok(()),
            Err(_) => Err(self.reason()),
        }
    }

    /// Ends the video.
    ///
    /// # Errors
    /// As [`Video::push`].
    pub fn finish(mut self) -> Result<(), ExportError> {
        drop(self.input.take());
        match self.child.wait() {
            Ok(status) if status.success() => Ok(()),
            _ => Err(self.reason()),
        }
    }

    /// What ffmpeg said.
    fn reason(&mut self) -> ExportError {
        drop(self.input.take());
        let _ = self.child.wait();
        let said = self.complaints.take().and_then(|read| read.join().ok());
        let what = last_words(&said.unwrap_or_default());
        self.ffmpeg.failed(what, FAILED)
    }
}

impl Drop for Video {
    fn drop(&mut self) {
        // It may have ended; then there is nothing to do, and nobody to tell.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// The last line of what a program said when it failed.
fn last_words(said: &str) -> String {
    let last = said.lines().map(str::trim).rfind(|line| !line.is_empty());
    let what = last.unwrap_or("it failed without a word");
    what.chars().take(LONGEST_REASON).collect()
}

/// A program for tests.
#[cfg(all(test, unix))]
#[allow(clippy::unwrap_used)]
pub(crate) fn script(dir: &Path, text: &str) -> PathBuf {
    let program = dir.join("ffmpeg");
    let written = dir.join("ffmpeg.sh");
    std::fs::write(&written, format!("#!/bin/sh\n{text}")).unwrap();
    // By another process: what is open for writing here, other tests' programs inherit, and it is busy then.
    let install = Command::new("install")
        .args(["-m", "755"])
        .args([&written, &program])
        .status();
    assert!(install.unwrap().success());
    program
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    #[test]
    fn a_missing_ffmpeg_says_how_to_get_it() {
        let error = Ffmpeg::at(Path::new("/no/such/ffmpeg")).unwrap_err();
        let said = error.to_string();
        assert!(
            said.starts_with("/no/such/ffmpeg: it was not found; install ffmpeg"),
            "{said}"
        );
    }

    #[cfg(unix)]
    #[test]
    fn what_ffmpeg_says_is_the_reason() {
        let dir = tempfile::tempdir().unwrap();
        let text = "case \"$*\" in *-encoders*) echo ' V....D libx264  H.264'; exit 0;; esac\n\
                    echo 'first' >&2; echo 'no space left' >&2; exit 1\n";
        let program = script(dir.path(), text);
        let ffmpeg = Ffmpeg::at(&program).unwrap();
        assert!(ffmpeg.can(Codec::Mp4Grey) && !ffmpeg.can(Codec::ProRes4444));
        let begin = |codec| ffmpeg.begin(&dir.path().join("a.mp4"), (2, 2), 12, codec);
        let error = begin(Codec::WebmAlpha).unwrap_err().to_string();
        assert!(error.contains("no encoder for a.mp4; install"), "{error}");
        let mut video = begin(Codec::Mp4Grey).unwrap();
        let pushed = video.push(&[0; 4]);
        let error = pushed.and_then(|()| video.finish()).unwrap_err();
        let error = error.to_string();
        assert!(
            error.contains("no space left; that is ffmpeg's own reason"),
            "{error}"
        );
        assert!(!error.contains("install"), "{error}");
    }

    #[cfg(unix)]
    #[test]
    fn an_ffmpeg_that_is_broken_is_not_one_that_can_nothing() {
        let dir = tempfile::tempdir().unwrap();
        let program = script(
            dir.path(),
            "echo ' V....D libx264  H.264'; echo 'libx.so.1: cannot open shared object file' >&2; echo >&2; exit 127\n",
        );
        let error = Ffmpeg::at(&program).unwrap_err();
        assert!(matches!(error, ExportError::Program { .. }));
        let said = error.to_string();
        assert!(
            said.contains("ffmpeg: libx.so.1: cannot open shared object file; ")
                && said.contains("install ffmpeg anew"),
            "{said}"
        );
    }
}
