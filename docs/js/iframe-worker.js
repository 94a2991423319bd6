// A browser starts no worker from a file, and the search of this site is one. Read from a folder, the site gives it a
// hidden frame instead. (The theme would load a polyfill of this name from another host.)
if (location.protocol === "file:") {
  window.Worker = class extends EventTarget {
    constructor(url) {
      super();
      const base = new URL(url, location.href);
      const frame = document.createElement("iframe");
      frame.hidden = true;
      frame.title = "search";
      document.body.append(frame);
      const inside = frame.contentWindow;
      const page = frame.contentDocument;
      page.open();
      page.write("<!doctype html><html lang='en'><title>search</title><body></body></html>");
      page.close();
      const load = (source) => new Promise((resolve, reject) => {
        const script = page.createElement("script");
        script.src = new URL(source, base);
        script.onload = resolve;
        script.onerror = reject;
        page.body.append(script);
      });
      inside.postMessage = (data) => this.dispatchEvent(new MessageEvent("message", { data }));
      inside.importScripts = (...sources) =>
        sources.reduce((before, source) => before.then(() => load(source)), Promise.resolve());
      this.inside = inside;
      this.loaded = load(base);
    }

    postMessage(data) {
      this.loaded.then(() => this.inside.dispatchEvent(new this.inside.MessageEvent("message", { data })));
    }

    terminate() {
      this.inside.frameElement.remove();
    }
  };
}
