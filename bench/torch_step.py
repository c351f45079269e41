"""One training step of two neural surfaces in plain PyTorch on the CPU: what there is without us.

Both fields are asked at every sample: a hash grid of 16 levels (16 to 2048 cells, 2 features, 2^19
entries) built from tensor operations, a distance network with one hidden layer of 64 whose normal
comes from a second backward pass, and a colour network with two. FoCoR has 12 features and an alpha
head, BaCo 7 features and m^P as a further input. Dense Adam. Prints one JSON object.
"""

import argparse
import json
import statistics
import time

import torch
from torch import nn
from torch.nn import functional as F

LEVELS, FEATURES, COARSEST, FINEST = 16, 2, 16, 2048


class HashGrid(nn.Module):
    """Positions in [0, 1]^3 to the features of all levels."""

    CORNERS = torch.tensor([[x, y, z] for z in (0, 1) for y in (0, 1) for x in (0, 1)])

    def __init__(self, entries):
        super().__init__()
        growth = (FINEST / COARSEST) ** (1 / (LEVELS - 1))
        self.cells = [int(COARSEST * growth**level + 1e-6) for level in range(LEVELS)]
        self.entries = entries
        sizes = [min(entries, (cells + 1) ** 3) for cells in self.cells]
        tables = [torch.empty(size, FEATURES).uniform_(-1e-4, 1e-4) for size in sizes]
        self.tables = nn.ParameterList(nn.Parameter(table) for table in tables)

    def level(self, points, cells, table):
        scaled = points * cells
        low = scaled.detach().floor().clamp(0, cells - 1)
        upper = scaled - low
        nodes = low.long().unsqueeze(1) + self.CORNERS
        x, y, z = nodes.unbind(-1)
        if (cells + 1) ** 3 <= self.entries:
            index = x + (cells + 1) * (y + (cells + 1) * z)
        else:
            index = (x ^ (y * 2654435761) ^ (z * 805459861)) % self.entries
        share = torch.stack([1 - upper, upper])  # of the lower and the upper node, along each axis
        along = [share[self.CORNERS[:, axis], :, axis] for axis in range(3)]
        weight = (along[0] * along[1] * along[2]).t()
        # An embedding: the gradient of plain indexing is summed on one core.
        return (F.embedding(index, table) * weight.unsqueeze(-1)).sum(1)

    def forward(self, points):
        features = [self.level(points, c, t) for c, t in zip(self.cells, self.tables)]
        return torch.cat(features, 1)


class Surface(nn.Module):
    """Distance, normal and colour of points in [-1, 1]^3."""

    def __init__(self, entries, features, extra, outputs, hidden=64):
        super().__init__()
        self.grid = HashGrid(entries)
        inputs = 3 + LEVELS * FEATURES
        self.distance = nn.Sequential(
            nn.Linear(inputs, hidden), nn.Softplus(beta=100), nn.Linear(hidden, 1 + features)
        )
        self.colour = nn.Sequential(
            nn.Linear(3 + 3 + 3 + 1 + features + extra, hidden),
            nn.ReLU(),
            nn.Linear(hidden, hidden),
            nn.ReLU(),
            nn.Linear(hidden, outputs),
            nn.Sigmoid(),
        )

    def forward(self, points, directions, extra=()):
        points = points.detach().requires_grad_()
        out = self.distance(torch.cat([points, self.grid(0.5 * points + 0.5)], 1))
        sdf = out[:, :1]
        (normal,) = torch.autograd.grad(sdf.sum(), points, create_graph=True)
        colour = self.colour(torch.cat([points, normal, directions, out, *extra], 1))
        return sdf.squeeze(1), normal, colour


def weights(sdf, slope, step, sharpness):
    """NeuS' weights of samples, [rays, samples]."""
    half = 0.5 * step * slope.clamp(max=0)
    before, after = torch.sigmoid(sharpness * (sdf - half)), torch.sigmoid(sharpness * (sdf + half))
    alpha = ((before - after + 1e-5) / (before + 1e-5)).clamp(0, 1)
    clear = torch.cumprod(1 - alpha + 1e-7, 1)
    return alpha * torch.cat([torch.ones_like(clear[:, :1]), clear[:, :-1]], 1)


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--rays", type=int, default=1024)
    parser.add_argument("--samples", type=int, default=64)
    parser.add_argument("--steps", type=int, default=5)
    parser.add_argument("--log2-entries", type=int, default=19)
    parser.add_argument("--threads", type=int, default=2)
    options = parser.parse_args()
    rays, samples = options.rays, options.samples
    torch.set_num_threads(options.threads)
    torch.manual_seed(1)

    foreground = Surface(2**options.log2_entries, features=12, extra=0, outputs=4)
    background = Surface(2**options.log2_entries, features=7, extra=1, outputs=3)
    log_sharpness = nn.Parameter(torch.tensor(0.3))
    parameters = [*foreground.parameters(), *background.parameters(), log_sharpness]
    adam = torch.optim.Adam(parameters, lr=1e-2, eps=1e-15)

    def losses():
        origins = 1.5 * F.normalize(torch.randn(rays, 3), dim=1)
        towards = F.normalize(torch.rand(rays, 3) - 0.5 - origins, dim=1)
        distances = 0.5 + 2 * (torch.arange(samples) + 0.5) / samples
        points = origins.unsqueeze(1) + towards.unsqueeze(1) * distances.view(1, -1, 1)
        points = points.clamp(-1, 1).view(-1, 3)
        directions = towards.repeat_interleave(samples, 0)
        photo, mask = torch.rand(rays, 3), (torch.rand(rays) < 0.5).float()
        sharpness = torch.exp(10 * log_sharpness)

        def drawn(field, *extra):
            sdf, normal, colour = field(points, directions, extra)
            slope = (normal * directions).sum(1)
            weight = weights(sdf.view(rays, -1), slope.view(rays, -1), 2 / samples, sharpness)
            pixel = (weight.unsqueeze(-1) * colour.view(rays, samples, -1)).sum(1)
            eikonal = ((normal.norm(dim=1) - 1) ** 2).mean()
            return pixel, eikonal, sdf

        front, eikonal_front, sdf = drawn(foreground)
        back, eikonal_back, _ = drawn(background, torch.rand(rays * samples, 1))
        matte = front[:, 3].clamp(1e-4, 1 - 1e-4)
        colour = matte.unsqueeze(1) * front[:, :3] + (1 - matte).unsqueeze(1) * back
        sparsity = torch.exp(-20 * sdf.abs()).mean()
        return (
            ((colour - photo) ** 2).mean()
            + 0.1 * (eikonal_front + eikonal_back)
            + 0.01 * sparsity
            + 0.1 * F.binary_cross_entropy(matte, mask)
        )

    times = []
    for _ in range(1 + options.steps):
        begun = time.perf_counter()
        loss = losses()
        adam.zero_grad()
        forward = time.perf_counter()
        loss.backward()
        backward = time.perf_counter()
        adam.step()
        end = time.perf_counter()
        times.append((end - begun, backward - forward, end - backward))
    step, backward, optimiser = (statistics.median(part) for part in zip(*times[1:]))
    figures = {
        "version": torch.__version__,
        "threads": options.threads,
        "samples_per_s": rays * samples / step,
        "step_ms": 1e3 * step,
        "backward_ms": 1e3 * backward,
        "adam_ms": 1e3 * optimiser,
    }
    print(json.dumps(figures))


if __name__ == "__main__":
    main()
