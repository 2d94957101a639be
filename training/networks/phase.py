"""Periodic autoencoders (Sec. III-B, Fig. 3): PAE and the body-part aware BP-PAE."""

import math

import torch
from torch import Tensor, nn

from runtime.motion.features import FPS, C
from runtime.skeleton import PART_JOINTS, PART_NAMES, SPORT_SKELETON, J
from training.presets import ModelConfig

WINDOW = 121  # frames, ±1 s
SPINE_JOINTS = ("Hips", "LowerBack", "Spine", "Spine1")


def two_hop_neighbours(joined_hips: bool = False) -> Tensor:
    """Return the mask `(31, 31)` of joints within two hops, in the same body part or on the spine (global motion).

    With `joined_hips` the thighs are neighbours too.
    """
    adjacency = torch.eye(J)
    for child, parent in enumerate(SPORT_SKELETON.parents):
        if parent >= 0:
            adjacency[child, parent] = adjacency[parent, child] = 1.0
    reach = (adjacency @ adjacency) > 0
    part = torch.zeros(J, dtype=torch.long)
    for number, name in enumerate(PART_NAMES):
        part[list(PART_JOINTS[name])] = number
    spine = torch.tensor([name in SPINE_JOINTS for name in SPORT_SKELETON.names])
    mask = (reach & ((part[:, None] == part[None, :]) | spine[None, :])).float()
    if joined_hips:
        left, right = (SPORT_SKELETON.index(f"{side}UpLeg") for side in ("Left", "Right"))
        mask[left, right] = mask[right, left] = 1.0
    return mask


class TwoHopGraphConvolution(nn.Module):
    """Graph convolution of joint velocities `(B, T, 31, 3)` over two-hop neighbourhoods, to the same shape."""

    mask: Tensor

    def __init__(self, joined_hips: bool = False) -> None:
        super().__init__()
        mask = two_hop_neighbours(joined_hips)
        self.register_buffer("mask", mask.repeat_interleave(3, 0).repeat_interleave(3, 1))
        start = torch.eye(3 * J) + 0.02 * torch.randn(3 * J, 3 * J)
        self.weight = nn.Parameter(start)
        self.bias = nn.Parameter(torch.zeros(3 * J))

    def forward(self, velocities: Tensor) -> Tensor:
        flat = velocities.flatten(-2)
        tokens = nn.functional.linear(flat, self.weight * self.mask, self.bias)
        return nn.functional.elu(tokens).view_as(velocities)


class PeriodicAutoencoder(nn.Module):
    """Autoencodes normalised velocities `(B, 121, 31, 3)` as C sinusoids.

    `encode` gives amplitude a, frequency f, offset b `(B, C)` and phase shift s `(B, C)` in turns;
    `phase_vectors` gives Eq. 1: (a sin 2 pi s, a cos 2 pi s) `(B, C, 2)` at the centres of windows of one sequence.
    """

    seconds: Tensor
    frequencies: Tensor

    def __init__(self, config: ModelConfig) -> None:
        super().__init__()
        channels, hidden, kernel = 3 * J, config.phase_hidden, config.phase_kernel
        self.graph = TwoHopGraphConvolution(config.joined_hips) if config.part_aware_phase else nn.Identity()
        self.encode_wide = nn.Conv1d(channels, hidden, kernel, padding=kernel // 2)
        self.encode_norm = nn.LayerNorm([hidden, WINDOW])
        self.encode_narrow = nn.Conv1d(hidden, C, kernel, padding=kernel // 2)
        self.shift = nn.ModuleList([nn.Linear(WINDOW, 2) for _ in range(C)])
        self.shift_norm = nn.ModuleList([nn.BatchNorm1d(2) for _ in range(C)])
        self.decode_wide = nn.Conv1d(C, hidden, kernel, padding=kernel // 2)
        self.decode_norm = nn.LayerNorm([hidden, WINDOW])
        self.decode_narrow = nn.Conv1d(hidden, channels, kernel, padding=kernel // 2)
        seconds = (torch.arange(WINDOW) - WINDOW // 2) / FPS
        self.register_buffer("seconds", seconds)
        self.register_buffer("frequencies", torch.fft.rfftfreq(WINDOW, 1.0 / FPS)[1:])

    def latent(self, velocities: Tensor) -> Tensor:
        """Return the latent curves L_i `(B, C, 121)`."""
        tokens = self.graph(velocities).flatten(-2).transpose(1, 2)
        return self.encode_narrow(torch.tanh(self.encode_norm(self.encode_wide(tokens))))

    def latent_along(self, sequence: Tensor, rows: Tensor) -> Tensor:
        """Return L_i of windows that begin at `rows` `(B,)` of one sequence `(T, 31, 3)`, at a quarter of the cost.

        Overlaps of windows are computed once. A window is zero-padded, so contributions from beyond its ends are subtracted.
        """
        weight, edge = self.encode_wide.weight, self.encode_wide.kernel_size[0] // 2
        tokens = self.graph(sequence).flatten(-2).T
        wide = nn.functional.conv1d(tokens, weight, self.encode_wide.bias, padding=edge)
        wide = wide[:, rows[:, None] + torch.arange(WINDOW, device=rows.device)].transpose(0, 1).contiguous()
        outside = rows[:, None] + torch.arange(edge, device=rows.device)
        tokens = nn.functional.pad(tokens, (edge, edge))
        before, behind = (tokens[:, outside + k].transpose(0, 1) for k in (0, WINDOW + edge))
        pad, conv = nn.functional.pad, nn.functional.conv1d
        wide[..., :edge] -= conv(pad(before, (0, edge - 1)), weight[..., :edge])
        wide[..., -edge:] -= conv(pad(behind, (edge - 1, 0)), weight[..., -edge:])
        return self.encode_narrow(torch.tanh(self.encode_norm(wide)))

    def encode(self, velocities: Tensor) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        return self._sinusoids(self.latent(velocities))

    def _sinusoids(self, latent: Tensor) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        latent = latent.float()
        spectrum = torch.fft.rfft(latent, dim=-1)
        power = spectrum.abs().square()[..., 1:]
        frequency = (power * self.frequencies).sum(-1) / power.sum(-1).clamp_min(1e-8)
        amplitude = 2.0 * power.sum(-1).clamp_min(1e-12).sqrt() / WINDOW
        offset = spectrum[..., 0].real / WINDOW
        shift = []
        for c in range(C):
            v = self.shift_norm[c](self.shift[c](latent[:, c]))
            shift.append(torch.atan2(v[:, 1], v[:, 0]) / (2.0 * math.pi))
        return amplitude, frequency, offset, torch.stack(shift, dim=1)

    def decode(self, amplitude: Tensor, frequency: Tensor, offset: Tensor, shift: Tensor) -> Tensor:
        """Return velocities `(B, 121, 31, 3)` from the sinusoids a sin(2 pi (f t + s)) + b."""
        angle = 2.0 * math.pi * (frequency[..., None] * self.seconds + shift[..., None])
        signal = amplitude[..., None] * torch.sin(angle) + offset[..., None]
        hidden = torch.tanh(self.decode_norm(self.decode_wide(signal)))
        return self.decode_narrow(hidden).transpose(1, 2).unflatten(-1, (J, 3))

    def forward(self, velocities: Tensor) -> Tensor:
        return self.decode(*self.encode(velocities))

    def phase_vectors(self, sequence: Tensor, rows: Tensor) -> Tensor:
        """Return Eq. 1: P^{2j-1} = a^j sin(2 pi s^j), P^{2j} = a^j cos(2 pi s^j); `(B, C, 2)` of windows that begin at `rows` `(B,)`."""
        amplitude, _, _, shift = self._sinusoids(self.latent_along(sequence, rows))
        angle = 2.0 * math.pi * shift
        return torch.stack([amplitude * angle.sin(), amplitude * angle.cos()], dim=-1)
