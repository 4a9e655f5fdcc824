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
    // Factor of the learning rates, 0 to 1.
    share: f32,
    // That of the columns of time.
    share_of_time: f32,
    // 1 if it is drawn behind all others, else 0.
    is_behind: u32,
}
