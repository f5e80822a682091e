// Browsers start no worker for a page that is a file. A hidden frame stands in for it, so that the search works there, too.
if (location.protocol === "file:") {
  window.IFrameWorker = window.Worker = class extends EventTarget {
    constructor(url) {
      super();
      const frame = document.createElement("iframe");
      frame.hidden = true;
      document.body.appendChild(frame);
      this.inside = frame.contentWindow;
      addEventListener("message", event => {
        if (event.source !== this.inside) return;
        const copy = new MessageEvent("message", { data: event.data });
        this.dispatchEvent(copy);
        if (this.onmessage) this.onmessage(copy);
      });
      const start = () => {
        postMessage = parent.postMessage.bind(parent);
        importScripts = (...urls) =>
          urls.reduce(
            (before, url) =>
              before.then(
                () =>
                  new Promise((resolve, reject) => {
                    const script = document.createElement("script");
                    script.src = url;
                    script.onload = resolve;
                    script.onerror = reject;
                    document.body.appendChild(script);
                  })
              ),
            Promise.resolve()
          );
      };
      this.ready = new Promise(resolve => {
        const page = this.inside.document;
        page.open();
        page.write(`<body><script>(${start})()</script><script src="${url}"></script></body>`);
        page.close();
        this.inside.addEventListener("load", resolve);
      });
    }

    postMessage(data) {
      this.ready.then(() => this.inside.dispatchEvent(new MessageEvent("message", { data })));
    }

    terminate() {
      this.inside.frameElement.remove();
    }
  };
}
