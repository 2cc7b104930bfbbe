//! Settings whose comments can be printed.

/// Declares a struct of settings, and a list `COMMENTS` of its fields with their comments.
macro_rules! documented {
    (
        $(#[doc = $about:literal])+
        $name:ident, $comments:ident {
            $(
                $(#[doc = $doc:literal])+
                $(#[serde($($serde:tt)*)])?
                $field:ident: $kind:ty,
            )*
        }
    ) => {
        $(#[doc = $about])+
        #[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
        #[serde(deny_unknown_fields, default)]
        pub struct $name {
            $(
                $(#[doc = $doc])+
                $(#[serde($($serde)*)])?
                pub $field: $kind,
            )*
        }

        /// The fields and their comments, line by line.
        pub(super) const $comments: &[(&str, &[&str])] =
            &[$((stringify!($field), &[$($doc),+])),*];
    };
}

pub(super) use documented;
