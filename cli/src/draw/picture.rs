//! From SVG source to what is stored: an SVG without text, and a PNG. Only the embedded fonts are used.

use super::canvas::Type;
use resvg::{tiny_skia, usvg};
use std::sync::{Arc, LazyLock};

/// Pixels of a PNG for a px of the SVG, so that it is sharp on dense screens and in print.
pub const PNG_SCALE: u32 = 2;

/// A finished picture.
#[derive(Clone, Debug, PartialEq)]
pub struct Picture {
    source: String,
    width: u32,
    height: u32,
}

/// A picture that could not be turned into pixels.
#[derive(Debug, thiserror::Error)]
pub enum DrawError {
    /// The source is no SVG: a bug of the drawing code.
    #[error("the picture is no valid SVG: {0}")]
    Svg(#[from] usvg::Error),
    /// No memory for the pixels.
    #[error("a picture of {width} × {height} pixels is too large to draw")]
    TooLarge {
        /// Pixels.
        width: u32,
        /// Pixels.
        height: u32,
    },
    /// The encoder refused.
    #[error("the picture can't be written as PNG: {0}")]
    Png(#[source] Box<dyn std::error::Error + Send + Sync>),
}

impl Picture {
    pub(super) fn new(source: String, width: u32, height: u32) -> Self {
        Self { source, width, height }
    }

    /// Width and height, px.
    pub fn size(&self) -> (u32, u32) {
        (self.width, self.height)
    }

    /// As SVG, with all text turned into outlines, so that it looks the same wherever it is opened.
    pub fn svg(&self) -> String {
        let options = usvg::WriteOptions {
            coordinates_precision: 3,
            transforms_precision: 6,
            indent: usvg::Indent::None,
            ..Default::default()
        };
        // The source itself is an SVG too: what remains if it can't be resolved, which would be a bug.
        self.tree().map_or_else(|_| self.source.clone(), |tree| tree.to_string(&options))
    }

    /// As PNG, [`PNG_SCALE`] pixels a px.
    pub fn png(&self) -> Result<Vec<u8>, DrawError> {
        let tree = self.tree()?;
        let (width, height) = (self.width * PNG_SCALE, self.height * PNG_SCALE);
        let mut pixels = tiny_skia::Pixmap::new(width, height).ok_or(DrawError::TooLarge { width, height })?;
        let scale = tiny_skia::Transform::from_scale(PNG_SCALE as f32, PNG_SCALE as f32);
        resvg::render(&tree, scale, &mut pixels.as_mut());
        pixels.encode_png().map_err(|e| DrawError::Png(Box::new(e)))
    }

    fn tree(&self) -> Result<usvg::Tree, usvg::Error> {
        usvg::Tree::from_str(&self.source, &OPTIONS)
    }
}

/// How wide a text will be, px.
pub(super) fn width(text: &str, style: Type) -> f64 {
    let mut canvas = super::canvas::Canvas::new();
    canvas.text(
        [0.0, 50.0],
        text,
        Type { upright: false, halo: false, ..style.anchored(super::canvas::Anchor::Start) },
    );
    let source = canvas.finish(1.0, 1.0);
    let Ok(tree) = usvg::Tree::from_str(&source, &OPTIONS) else { return 0.0 };
    // The background is the first child, the text, if any of it can be seen, the second.
    tree.root().children().get(1).map_or(0.0, |text| f64::from(text.bounding_box().right()))
}

/// The text, cut with an ellipsis to be no wider than `room` px.
pub(super) fn fitted(text: &str, style: Type, room: f64) -> String {
    if width(text, style) <= room {
        return text.to_owned();
    }
    let letters: Vec<char> = text.chars().collect();
    let cut = |n: usize| format!("{}…", letters[..n].iter().collect::<String>().trim_end());
    let (mut fits, mut exceeds) = (0, letters.len());
    while exceeds - fits > 1 {
        let middle = (fits + exceeds) / 2;
        if width(&cut(middle), style) <= room { fits = middle } else { exceeds = middle }
    }
    cut(fits)
}

static OPTIONS: LazyLock<usvg::Options<'static>> = LazyLock::new(|| {
    let mut fonts = usvg::fontdb::Database::new();
    fonts.load_font_data(include_bytes!("../../fonts/Inter-Regular.otf").to_vec());
    fonts.load_font_data(include_bytes!("../../fonts/Inter-SemiBold.otf").to_vec());
    usvg::Options { font_family: "Inter".into(), fontdb: Arc::new(fonts), ..Default::default() }
});
