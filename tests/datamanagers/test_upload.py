"""How images get to a device. What a GPU does is asked of one where there is one."""

import threading

import pytest
import torch

from gsfw.datamanagers.device_images import CudaUpload, PlainUpload, upload_to


@pytest.fixture
def gpu() -> torch.device:
    if not torch.cuda.is_available():
        pytest.skip("torch sees no GPU here")
    return torch.device("cuda", torch.cuda.current_device())


def test_nothing_is_sent_to_the_cpu():
    assert upload_to(torch.device("cpu")) is None


def test_other_devices_are_copied_to_at_once():
    upload = upload_to(torch.device("meta"))
    assert isinstance(upload, PlainUpload)
    shipment = upload.send((torch.ones(2, 3), torch.ones(4, dtype=torch.bool)))
    assert shipment.sent is None
    assert [tensor.device.type for tensor in upload.receive(shipment)] == ["meta", "meta"]


@pytest.mark.cuda
def test_what_arrives_on_a_gpu_is_what_was_sent(gpu):
    upload = upload_to(gpu)
    assert isinstance(upload, CudaUpload)
    pixels = torch.randint(0, 256, (48, 64, 3), dtype=torch.uint8)
    mask = pixels[..., 0] > 100
    for tensors in ((pixels,), (pixels, mask), (pixels.transpose(0, 1),)):
        arrived = upload.receive(upload.send(tensors))
        assert all(tensor.device == gpu for tensor in arrived)
        pairs = zip(tensors, arrived, strict=True)
        assert all(torch.equal(here, there.cpu()) for here, there in pairs)


@pytest.mark.cuda
def test_neither_memory_is_lent_out_while_it_is_used(gpu):
    # Images are sent by a thread while the main stream is far behind with using the ones before;
    # a buffer, or memory of the GPU, that is used again too early shows as a wrong number.
    upload = CudaUpload(gpu)
    busy = torch.rand(2048, 2048, device=gpu)
    sums, wanted = [], []
    for number in range(200):
        image = torch.full((256, 256, 3), number % 251, dtype=torch.uint8)
        shipments = []
        thread = threading.Thread(
            target=lambda p=image, into=shipments: into.append(upload.send((p,)))
        )
        thread.start()
        thread.join()
        if number % 10 == 0:
            busy = (busy @ busy).clamp(0, 1)
        (there,) = upload.receive(shipments.pop())
        sums.append(there.long().sum())
        wanted.append((number % 251) * image.numel())
        del there
    assert torch.stack(sums).tolist() == wanted
    assert bool(busy.isfinite().all())


@pytest.mark.cuda
def test_receiving_does_not_wait(gpu):
    upload = CudaUpload(gpu)
    upload.receive(upload.send((torch.ones(1000, 1000),)))  # Gets its memory, which may wait.
    torch.cuda.synchronize(gpu)
    torch.cuda._sleep(200_000_000)  # About a tenth of a second of the GPU's clock.
    event = torch.cuda.Event()
    event.record()
    upload.receive(upload.send((torch.ones(1000, 1000),)))
    assert not event.query(), "the host waited for what the GPU was doing"
