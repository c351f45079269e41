//! Pixels of photos and masks: in memory, or in files that the system pages in and out.
//!
//! A step looks at some hundred pixels of all views, wherever they are. Pictures that would fill the
//! memory lie in files without a name instead, mapped into the address space: what is looked at often
//! stays in the system's page cache, and what it has no room for is read again.

use image::{ImageBuffer, Rgb, RgbImage};
use memmap2::Mmap;
use std::fmt;
use std::io::Write as _;
use std::ops::Deref;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};

use super::error::PrepareError;

/// Pixels up to this many bytes in all are kept in memory.
const IN_MEMORY: u64 = 2 << 30;

/// A photo, 8-bit sRGB.
pub type Photo = ImageBuffer<Rgb<u8>, PixelBytes>;

/// Bytes, wherever they are. Clones share them.
#[derive(Clone)]
pub struct PixelBytes(Arc<Place>);

enum Place {
    Memory(Held),
    File(Mmap),
}

impl PixelBytes {
    /// How many of them take room in memory for good.
    #[must_use]
    pub fn in_memory(&self) -> usize {
        match &*self.0 {
            Place::Memory(held) => held.bytes.len(),
            Place::File(_) => 0,
        }
    }
}

impl Deref for PixelBytes {
    type Target = [u8];

    fn deref(&self) -> &[u8] {
        match &*self.0 {
            Place::Memory(held) => &held.bytes,
            Place::File(map) => map,
        }
    }
}

impl PartialEq for PixelBytes {
    fn eq(&self, other: &Self) -> bool {
        **self == **other
    }
}

impl fmt::Debug for PixelBytes {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let place = match &*self.0 {
            Place::Memory(_) => "in memory",
            Place::File(_) => "in a file",
        };
        write!(f, "{} bytes {place}", self.len())
    }
}

/// Bytes in memory; their store has room for others once nobody looks at them any more.
struct Held {
    bytes: Vec<u8>,
    store: PixelStore,
}

impl Drop for Held {
    fn drop(&mut self) {
        let bytes = self.bytes.len() as u64;
        self.store.0.room.fetch_add(bytes, Relaxed);
    }
}

/// Where a scene's pixels are kept: the first of them in memory, the rest in files without a name.
/// Clones are the same store.
#[derive(Clone, Debug)]
pub struct PixelStore(Arc<Shelf>);

#[derive(Debug)]
struct Shelf {
    folder: PathBuf,
    /// Bytes that memory still takes.
    room: AtomicU64,
}

impl PixelStore {
    /// With files in `folder`, once there are 2 GiB in memory.
    #[must_use]
    pub fn new(folder: &Path) -> Self {
        Self::with_room(folder, IN_MEMORY)
    }

    /// With files in `folder`, once there are `room` bytes in memory.
    #[must_use]
    pub fn with_room(folder: &Path, room: u64) -> Self {
        Self(Arc::new(Shelf {
            folder: folder.to_path_buf(),
            room: AtomicU64::new(room),
        }))
    }

    /// Puts bytes where they are to be kept.
    ///
    /// # Errors
    /// [`PrepareError::Store`] when there is no room in the folder.
    pub fn keep(&self, bytes: Vec<u8>) -> Result<PixelBytes, PrepareError> {
        let size = bytes.len() as u64;
        let taken = |room: u64| room.checked_sub(size);
        if self.0.room.try_update(Relaxed, Relaxed, taken).is_ok() {
            let store = self.clone();
            return Ok(PixelBytes(Arc::new(Place::Memory(Held { bytes, store }))));
        }
        let map = || -> std::io::Result<Mmap> {
            let mut file = tempfile::tempfile_in(&self.0.folder)?;
            // Written and not mapped first: a full disk is an error, not a signal.
            file.write_all(&bytes)?;
            // SAFETY: the file has no name and is closed after this, so that nobody can open it to
            // shorten or change it.
            unsafe { Mmap::map(&file) }
        };
        let map = map().map_err(|source| PrepareError::Store {
            folder: self.0.folder.clone(),
            source,
        })?;
        Ok(PixelBytes(Arc::new(Place::File(map))))
    }

    /// Puts a photo where it is to be kept.
    ///
    /// # Errors
    /// As [`keep`](Self::keep).
    pub fn keep_photo(&self, photo: RgbImage) -> Result<Photo, PrepareError> {
        let (width, height) = photo.dimensions();
        let bytes = self.keep(photo.into_raw())?;
        #[allow(clippy::expect_used)] // they are those of the picture
        Ok(Photo::from_raw(width, height, bytes).expect("three bytes for each pixel"))
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn pictures_in_files_are_the_pictures() {
        let folder = tempfile::tempdir().unwrap();
        let store = PixelStore::with_room(folder.path(), 34);
        let picture = RgbImage::from_fn(7, 5, |x, y| Rgb([x as u8, y as u8, 200]));
        let photo = store.keep_photo(picture.clone()).unwrap();
        let second = photo.clone();
        drop(photo);
        assert!(picture.pixels().eq(second.pixels()));
        assert_eq!(second.get_pixel(6, 4), picture.get_pixel(6, 4));
        assert_eq!(format!("{:?}", second.as_raw()), "105 bytes in a file");
        assert_eq!(second.as_raw().in_memory(), 0);
        // They leave nothing to be tidied up.
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);

        let gone = PixelStore::with_room(&folder.path().join("gone"), 0);
        let error = gone.keep_photo(picture).unwrap_err().to_string();
        assert!(
            error.contains("gone") && error.contains("TMPDIR"),
            "{error}"
        );
    }

    #[test]
    fn memory_is_used_first_and_again() {
        let folder = tempfile::tempdir().unwrap();
        let store = PixelStore::with_room(folder.path(), 250);
        let keep = || store.keep(vec![0; 105]).unwrap();
        let mut kept = vec![keep(), keep(), keep()];
        let places = |kept: &[PixelBytes]| -> Vec<usize> {
            kept.iter().map(PixelBytes::in_memory).collect()
        };
        assert_eq!(places(&kept), [105, 105, 0]);
        // Whoever looks at it last gives the room back.
        let shared = kept[0].clone();
        kept.remove(0);
        kept.push(keep());
        drop(shared);
        kept.push(keep());
        assert_eq!(places(&kept), [105, 0, 0, 105]);
    }
}
