//! [`Clocks`]: the clocks of the headset's processor, which Meta's runtime logs.

/// Clocks of the headset's processor: medians over a run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Clocks {
    pub(super) cpu_mhz: u32,
    pub(super) gpu_mhz: u32,
}

impl Clocks {
    /// Reads the lines that Meta's runtime logs once a second, the last `seconds` of them; `None` without any.
    pub(super) fn parse(log: &str, seconds: f64) -> Option<Clocks> {
        let lines = log.lines().rev().filter_map(Clocks::of_line).take(seconds.ceil() as usize);
        let (mut cpu, mut gpu): (Vec<u32>, Vec<u32>) =
            lines.map(|clocks| (clocks.cpu_mhz, clocks.gpu_mhz)).unzip();
        Some(Clocks { cpu_mhz: median(&mut cpu)?, gpu_mhz: median(&mut gpu)? })
    }

    /// The clocks in `FPS=72/72,...,CPU4/GPU=2/4,1651/670MHz,OC=FF,...`: the field after the levels.
    fn of_line(line: &str) -> Option<Clocks> {
        let mut fields = line.split(',').skip_while(|field| !field.contains("/GPU="));
        let (cpu, gpu) = fields.nth(1)?.strip_suffix("MHz")?.split_once('/')?;
        Some(Clocks { cpu_mhz: cpu.parse().ok()?, gpu_mhz: gpu.parse().ok()? })
    }
}

fn median(numbers: &mut [u32]) -> Option<u32> {
    numbers.sort_unstable();
    numbers.get(numbers.len() / 2).copied()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn clocks_are_medians_of_the_end_of_the_log() {
        let line =
            |cpu: u32, gpu: u32| format!("FPS=72/72,Prd=38ms,CPU4/GPU=2/4,{cpu}/{gpu}MHz,OC=FF,App=4.49ms\n");
        let log = ["--------- beginning of main\n".into(), line(9, 9), line(9, 9), line(9, 9)].concat();
        let log =
            [log, line(1651, 670), "other,CPU4/GPU=2/4\n".into(), line(1171, 441), line(1651, 670)].concat();
        assert_eq!(Clocks::parse(&log, 2.5), Some(Clocks { cpu_mhz: 1651, gpu_mhz: 670 }));
        assert_eq!(Clocks::parse(&log, 60.0), Some(Clocks { cpu_mhz: 1171, gpu_mhz: 441 }));
        assert_eq!(Clocks::parse("--------- beginning of main\n", 60.0), None);
    }
}
