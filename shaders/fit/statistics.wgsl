// Per-Gaussian statistics, kept from step to step.

struct Statistics {
    // Sum of the norms of the screen-space gradients since the last capacity control, and the number of
    // images that showed the Gaussian since.
    screen_gradient: f32,
    images: u32,
    // Number of gradients in Adam's moments.
    visits: u32,
    // 1 if Adam can use the gradient of this step, else 0.
    is_usable: u32,
}
