# The main part of `make demo`: docker build -t drl-av . && docker run -v "$PWD/demo:/drl-av/demo" drl-av
FROM python:3.11-slim
RUN apt-get update \
    && apt-get install -y --no-install-recommends make libx11-6 libxext6 libxrender1 libgl1 libglu1-mesa \
    && rm -rf /var/lib/apt/lists/*
# The package index of torch's CPU build; without it pip also installs gigabytes of GPU libraries.
ARG PIP_EXTRA_INDEX_URL
WORKDIR /drl-av
COPY . .
RUN pip install --no-cache-dir -c constraints.txt '.[train]'
CMD ["make", "--old-file=setup", "BIN=/usr/local/bin", "demo"]
