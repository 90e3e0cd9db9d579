# Everything of `make setup` in an image: ROS 2 from PyPI, messages, package, tests.
#
#     docker build -t vpsci_ros .      # --build-arg PIP_EXTRA_INDEX_URL=...: PyTorch's CPU index, which saves gigabytes
#     docker run --rm -it vpsci_ros vpsci --help
FROM python:3.11-slim-bookworm
ARG PIP_EXTRA_INDEX_URL=""
# hadolint ignore=DL3008
RUN apt-get update \
    && apt-get install -y --no-install-recommends g++ make \
    && rm -rf /var/lib/apt/lists/*
WORKDIR /vpsci_ros
COPY . .
RUN make setup
ENV PATH="/vpsci_ros/.venv/bin:$PATH" ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST
CMD ["vpsci", "--help"]
