# The main part of `make demo`: docker build -t drl-av . && docker run -v "$PWD/demo:/drl-av/demo" drl-av
FROM python:3.11-slim
RUN apt-get update \
    && apt-get install -y --no-install-recommends make libx11-6 libxext6 libxrender1 libgl1 libglu1-mesa \
    && rm -rf /var/lib/apt/lists/*
RUN pip install --no-cache-dir torch==2.13.0 --index-url https://download.pytorch.org/whl/cpu
WORKDIR /drl-av
COPY . .
RUN pip install --no-cache-dir -c constraints.txt '.[train]'
CMD ["make", "--old-file=setup", "BIN=/usr/local/bin", "demo"]
