//! Laws of the pictures.
